import { expect, test } from "@playwright/test";
import { drive, openLive, sessionName, staysAtRest, takeControl, untilAtRest } from "../support/live";
import { hold, holdButton } from "../support/page";

test("of two browsers one drives, both stop, and control is handed over or taken over", async ({ browser }) => {
  const [first, second] = [await browser.newContext(), await browser.newContext()];
  const [ada, bob] = [await first.newPage(), await second.newPage()];
  const errors = [await openLive(ada, "teleop"), await openLive(bob, "teleop")];
  const [adaName, bobName] = [await sessionName(ada), await sessionName(bob)];
  expect(adaName).not.toBe(bobName);

  // Whoever comes first drives; the other can neither drive nor take control by a request of its own.
  await takeControl(ada);
  await expect(bob.getByText(`${adaName} has control`).first()).toBeVisible();
  await bob.keyboard.press("KeyQ", { delay: 600 });
  await expect(bob.getByText("Sticks are blocked")).toBeVisible();
  const refused = await bob.evaluate(async () => {
    const options = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ action: "take" }) };
    return (await fetch("/_api/lease", options)).status;
  });
  expect(refused).toBe(403);
  await untilAtRest();

  // The other stops. Whoever has control sees who it was, and releases it; the next press stops again.
  await drive(ada, "KeyQ");
  await bob.getByTestId("stop").click();
  await untilAtRest();
  await ada.keyboard.up("KeyQ");
  const banner = (page: typeof ada) => page.getByRole("status").filter({ hasText: "This browser is" });
  await expect(banner(ada)).toContainText(`Stopped by ${bobName}`);
  await expect(banner(ada)).toContainText(`This browser is ${adaName}.`);
  await expect(banner(bob)).toContainText("Stopped by you");
  await expect(banner(bob)).toContainText(`${adaName} has control and can release it.`);
  await expect(bob.getByTestId("release")).toBeDisabled();
  await hold(ada, "release");
  await expect(ada.getByTestId("stop")).not.toContainText("Stopped");
  await expect(bob.getByText(`${adaName} has released your stop.`)).toBeVisible();
  await staysAtRest(ada);
  await expect(bob.getByTestId("stop")).not.toContainText("Stopped");
  await bob.getByTestId("stop").click();
  await expect(ada.getByTestId("stop")).toContainText("Stopped");

  // Both stop: each lets go of its own, and the robot is free once nobody holds it.
  await ada.getByTestId("stop").click();
  await expect(banner(ada)).toContainText(`Stopped by you`);
  await expect(banner(ada)).toContainText(`by ${bobName}`);
  await holdButton(bob, bob.getByRole("button", { name: "Hold to let go of your stop" }));
  await expect(banner(ada)).not.toContainText(`by ${bobName}`);
  await expect(bob.getByTestId("stop")).toContainText("Stopped");
  await hold(ada, "release");
  for (const page of [ada, bob]) await expect(page.getByTestId("stop")).not.toContainText("Stopped");
  await staysAtRest(ada);

  // Control is asked for and handed over, and then taken over.
  await bob.locator("header").getByRole("button", { name: `${adaName} has control` }).click();
  await bob.getByRole("button", { name: "Ask for control" }).click();
  await ada.getByRole("button", { name: "Hand over" }).click();
  await expect(ada.getByText(`${bobName} has control`).first()).toBeVisible();
  await expect(ada.getByText("Sticks are blocked")).toBeVisible();
  await bob.keyboard.press("Escape");
  await takeControl(bob);
  await drive(bob, "KeyE");
  await ada.locator("header").getByRole("button", { name: `${bobName} has control` }).click();
  await holdButton(ada, ada.getByRole("button", { name: `Hold to take over from ${bobName}` }));
  await expect(bob.getByText(`${adaName} has control`).first()).toBeVisible();
  await untilAtRest();
  await bob.keyboard.up("KeyE");
  expect(errors.flat()).toEqual([]);
  await first.close();
  await second.close();
});
