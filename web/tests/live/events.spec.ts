import { type Page, expect, test } from "@playwright/test";
import { CONSOLE, Network, drive, openLive, sessionName, staysAtRest, takeControl, untilAtRest } from "../support/live";
import { holdButton } from "../support/page";

const button = (page: Page, name: string) => page.getByRole("button", { name, exact: true });
const notice = (page: Page, text: string) => expect(page.getByText(text, { exact: false }).first()).toBeVisible();

/** Open the list of events on the tab Map. */
async function openEvents(page: Page): Promise<void> {
  await page.locator("#tab-map").click();
  await page.getByRole("tab", { name: "Events" }).click();
}

async function openControl(page: Page, holder: string): Promise<void> {
  await page.locator("header").getByRole("button", { name: `${holder} has control` }).click();
}

test("every loss of control is said to who lost it, and is on record with every stop afterwards", async ({ browser }) => {
  const network = await Network.open();
  const [ada, bob] = [await (await browser.newContext()).newPage(), await (await browser.newContext()).newPage()];
  const errors = [await openLive(ada, "teleop"), await openLive(bob, "teleop", network.url)];
  const [adaName, bobName] = [await sessionName(ada), await sessionName(bob)];
  await takeControl(ada);

  // A request for control that nobody answers: the holder's dialog counts down, and the requester is told.
  await openControl(bob, adaName);
  await button(bob, "Ask for control").click();
  const left = async () => Number(/you keep control: (\d+) s/.exec((await ada.getByRole("dialog").textContent()) ?? "")?.[1] ?? -1);
  await expect.poll(left).toBeGreaterThan(0);
  const first = await left();
  await expect.poll(left, { intervals: [200] }).toBeLessThan(first);
  await notice(bob, `${adaName} has not answered: you have no control.`);
  await notice(ada, "You have control");

  // Control that was taken over.
  await holdButton(bob, button(bob, `Hold to take over from ${adaName}`));
  await notice(ada, `You have lost control: ${bobName} has taken it over.`);
  await bob.keyboard.press("Escape");
  await takeControl(bob);

  // Control that was lost without a word, while driving.
  await drive(bob, "KeyQ");
  network.cut();
  await untilAtRest();
  await expect(ada.getByTestId("stop")).toContainText("Stopped");
  await bob.context().close();
  await expect(ada.getByTestId("control")).toContainText("Nobody has control");
  await takeControl(ada);
  await staysAtRest(ada);

  const expected = [
    `${bobName} asked for control; ${adaName} did not answer`,
    `${bobName} took control over from ${adaName}`,
    `${bobName} stopped answering: the robot was stopped`,
    `${bobName} stopped answering and lost control`,
    `${adaName} released the stop of ${bobName}`,
  ];
  for (const again of [false, true]) {
    if (again) await ada.reload();
    await openEvents(ada);
    for (const text of expected) await expect(ada.getByRole("list", { name: "Events" }).getByText(text).first(), text).toBeVisible();
  }
  await ada.locator("#tab-logs").click();
  await ada.getByRole("radio", { name: "Commands" }).click();
  const journal = ada.getByRole("listitem").filter({ hasText: bobName });
  for (const what of ["has control, taken from", "was silent and lost control"]) await expect(journal.filter({ hasText: what }).first(), what).toBeVisible();
  expect(errors.flat()).toEqual([]);
  await ada.context().close();
  network.close();
});

test("a page on another rosbridge watches and stops, and drives nothing", async ({ browser }) => {
  const [ada, far] = [await (await browser.newContext()).newPage(), await (await browser.newContext()).newPage()];
  const errors = [await openLive(ada, "teleop")];
  await takeControl(ada);
  errors.push(await openLive(far, "teleop", `${CONSOLE}/?ros=ws://127.0.0.1:9090`));
  await expect(far.getByTestId("elsewhere")).toContainText("ws://127.0.0.1:9090");
  await far.keyboard.press("KeyQ", { delay: 1500 });
  await staysAtRest(far);
  await drive(ada, "KeyQ");
  await far.getByTestId("stop").click();
  await untilAtRest();
  await ada.keyboard.up("KeyQ");
  await expect(ada.getByTestId("stop")).toContainText("Stopped");
  await expect(far.getByTestId("release")).toBeDisabled();
  await holdButton(far, button(far, "Hold to let go of your stop"));
  await expect(ada.getByTestId("stop")).not.toContainText("Stopped");
  await staysAtRest(ada);
  expect(errors.flat()).toEqual([]);
  for (const page of [ada, far]) await page.context().close();
});
