import { expect, test } from "@playwright/test";
import { drive, openLive, takeControl, untilAtRest } from "../support/live";
import { hold, holdButton } from "../support/page";

test("of two tabs of a browser, the one that watches lets go of its own stop only, and the other releases it", async ({ context }) => {
  const [first, second] = [await context.newPage(), await context.newPage()];
  const errors = [await openLive(first, "teleop")];
  await takeControl(first);
  errors.push(await openLive(second, "teleop"));
  await expect(second.getByTestId("other-tab")).toBeVisible();

  // To the server both tabs are one session with control: letting go of one's stop must not release the other's.
  await second.getByTestId("stop").click();
  await expect(first.getByRole("status").filter({ hasText: "by this browser, in another tab" })).toBeVisible();
  await first.getByTestId("stop").click();
  await holdButton(second, second.getByRole("button", { name: "Hold to let go of your stop" }));
  await second.waitForTimeout(3000);
  await expect(first.getByTestId("stop")).toContainText("Stopped");
  await expect(second.getByTestId("stop")).toContainText("Stopped");
  await hold(first, "release");
  await expect(first.getByTestId("stop")).not.toContainText("Stopped");

  // The tab that commands releases the stop of the other one, and the other way round once that has taken over.
  await second.getByTestId("stop").click();
  await expect(first.getByTestId("stop")).toContainText("Stopped");
  await first.waitForTimeout(1000);
  await hold(first, "release");
  await expect(second.getByTestId("stop")).not.toContainText("Stopped");
  await first.getByTestId("stop").click();
  await expect(second.getByTestId("stop")).toContainText("Stopped");
  await second.getByRole("button", { name: "Take over in this tab" }).click();
  await expect(first.getByTestId("other-tab")).toBeVisible();
  await second.waitForTimeout(2000);
  await hold(second, "release");
  await expect(second.getByTestId("stop")).not.toContainText("Stopped");
  await drive(second, "KeyQ");
  await second.keyboard.up("KeyQ");
  await untilAtRest();
  expect(errors.flat()).toEqual([]);
  await first.close();
  await second.close();
});
