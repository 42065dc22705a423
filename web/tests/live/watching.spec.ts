import { type Page, expect, test } from "@playwright/test";
import { openLive, sentence, staysAtRest, takeControl, untilAtRest, untilMoving } from "../support/live";
import { hold, holdButton } from "../support/page";

const stopOf = (page: Page) => page.getByTestId("stop");
const button = (page: Page, name: string | RegExp) => page.getByRole("button", { name, exact: typeof name === "string" });

/** Make the robot ready for a mission, whatever the specs before have left, and start an exploration. */
async function explore(page: Page): Promise<void> {
  const reset = button(page, "Reset the fault");
  if ((await sentence(page).textContent())?.includes("fault") === true) await reset.click();
  await page.getByText("Explore", { exact: false }).first().click();
  // The mission refuses a start within 0.4 s after a release, and says so: it is to be started again.
  await expect(async () => {
    await page.getByTestId("start-mission").click();
    await expect(button(page, "Pause")).toBeVisible({ timeout: 5000 });
  }).toPass();
  await untilMoving();
}

async function lease(page: Page, action: "Give up control" | "Take control"): Promise<void> {
  await page.getByTestId("control").click();
  await button(page, action).click();
  await page.keyboard.press("Escape");
}

/** Do what the command palette finds for some words. */
async function order(page: Page, words: string): Promise<void> {
  await page.keyboard.press("Control+k");
  await page.keyboard.type(words);
  await page.keyboard.press("Enter");
}

test("a page that is not open for driving sets nothing in motion, and holds nothing", async ({ browser }) => {
  const [ada, bob] = [await (await browser.newContext()).newPage(), await (await browser.newContext()).newPage()];
  const errors = [await openLive(ada, "map"), await openLive(bob, "map")];
  await takeControl(ada);
  await explore(ada);
  await lease(ada, "Give up control");
  await expect(bob.getByTestId("control")).toContainText("Nobody has control");

  // A light takes control, and the mission drives on.
  await order(bob, "light purple");
  await expect(bob.getByTestId("control")).toContainText("You have control");
  for (let second = 0; second < 4; second += 1) {
    await bob.waitForTimeout(1000);
    await untilMoving();
  }
  await expect(stopOf(bob)).not.toContainText("Stopped");

  // Control that was given up stays given up; taking it again is no silence.
  await lease(bob, "Give up control");
  await bob.waitForTimeout(1500);
  await expect(bob.getByTestId("control")).toContainText("Nobody has control");
  await lease(bob, "Take control");
  await bob.waitForTimeout(2500);
  await expect(bob.getByTestId("control")).toContainText("You have control");
  await expect(stopOf(bob)).not.toContainText("Stopped");

  // It pauses what moves, and resumes nothing before it was opened.
  await button(bob, "Pause").click();
  await expect(sentence(bob)).toContainText("Mission paused");
  await untilAtRest();
  for (const name of ["Resume", /and dock$/]) await expect(button(bob, name)).toBeDisabled();
  await expect(button(bob, "Hold to abort")).toBeDisabled();
  await order(bob, "resume");
  await bob.keyboard.press("Escape");
  await staysAtRest(bob);
  await hold(bob, "release");
  await expect(button(bob, "Resume")).toBeEnabled();
  await staysAtRest(bob);
  await button(bob, "Resume").click();
  await untilMoving();

  // Space stops, also where a button to be held has the focus; that button does nothing.
  await button(bob, "Hold to abort").focus();
  await bob.keyboard.press("Space", { delay: 1600 });
  await expect(stopOf(bob)).toContainText("Stopped");
  await untilAtRest();
  await expect(sentence(bob)).toContainText("Stopped");
  await hold(bob, "release");
  await expect(sentence(bob)).toContainText("Mission paused");
  // A click that no pointer made stops, too.
  await stopOf(bob).evaluate((stop: HTMLElement) => stop.click());
  await expect(stopOf(bob)).toContainText("Stopped");
  await hold(bob, "release");

  await holdButton(bob, button(bob, "Hold to abort"));
  await expect(button(bob, "Hold to abort")).toBeEnabled();
  await holdButton(bob, button(bob, "Hold to abort"));
  await expect(sentence(bob)).toContainText("Mission done");
  expect(errors.flat()).toEqual([]);
  await ada.context().close();
  await bob.context().close();
});

test("what the page says of a goal is what the robot does", async ({ browser }) => {
  const [ada, bob] = [await (await browser.newContext()).newPage(), await (await browser.newContext()).newPage()];
  const errors = [await openLive(ada, "map"), await openLive(bob, "teleop")];
  await takeControl(ada);
  const canDrive = button(ada, /Can I drive/);
  const surface = ada.locator("[aria-describedby=map-keys]");
  await surface.focus();
  await ada.keyboard.press("g");
  for (let step = 0; step < 6; step += 1) await ada.keyboard.press("ArrowRight");
  await expect(ada.getByTestId("send-pose")).toBeEnabled();
  await ada.keyboard.press("Enter");
  await untilMoving();
  for (const page of [ada, bob]) await expect(sentence(page)).toContainText("Driving to a goal");
  await expect(canDrive).toContainText("let go and it drives on to its goal");
  await stopOf(ada).click();
  await untilAtRest();
  await expect(sentence(bob)).toContainText("Stopped");
  await hold(ada, "release");
  await staysAtRest(ada);
  for (const page of [ada, bob]) await expect(sentence(page)).not.toContainText("goal");
  await expect(canDrive).toContainText("the robot stops within 0.5 s");
  expect(errors.flat()).toEqual([]);
  await ada.context().close();
  await bob.context().close();
});

test("a page in control that opens everything stops nothing", async ({ browser }) => {
  const ada = await (await browser.newContext()).newPage();
  const errors = [await openLive(ada, "teleop")];
  await takeControl(ada);
  for (const tab of ["map", "cameras", "telemetry", "arm", "logs", "map", "teleop"]) {
    await ada.locator(`#tab-${tab}`).click();
    await ada.waitForTimeout(800);
  }
  await order(ada, "settings");
  const bob = await (await browser.newContext()).newPage();
  errors.push(await openLive(bob, "map"));
  await ada.waitForTimeout(3000);
  for (const page of [ada, bob]) await expect(stopOf(page)).not.toContainText("Stopped");
  await expect(bob.getByText("has control").first()).toBeVisible();
  expect(errors.flat()).toEqual([]);
  await ada.context().close();
  await bob.context().close();
});
