import { expect, test } from "@playwright/test";
import { Network, consolePid, drive, fallAsleep, openLive, recordTexts, staysAtRest, takeControl, untilAtRest, untilLive, untilReplaced } from "../support/live";
import { TABS } from "../support/page";

for (const signal of ["SIGKILL", "SIGSTOP"] as const) {
  test(`every tab shows the loss of its server by ${signal}, and comes back`, async ({ context }) => {
    const pages = await Promise.all(TABS.map(async (tab) => ({ tab, page: await context.newPage() })));
    const errors = [];
    for (const { tab, page } of pages) errors.push(await openLive(page, tab));
    const pid = consolePid();
    process.kill(pid, signal);
    await Promise.all(pages.map(({ page }) => expect(page.getByRole("alert").filter({ hasText: "No link." })).toBeVisible({ timeout: 60_000 })));
    await untilReplaced(pid);
    await Promise.all(pages.map(({ page }) => untilLive(page)));
    // No panel of any tab is out of date any more.
    for (const { tab, page } of pages) await expect(page.locator("#view .hatched"), tab).toHaveCount(0);
    expect(errors.flat()).toEqual([]);
  });
}

test("a page knows its own stop after the server came back, and after it was reloaded", async ({ page }) => {
  const errors = await openLive(page, "map");
  await takeControl(page);
  await page.getByTestId("stop").click();
  const banner = page.getByRole("status").filter({ hasText: "This browser is" });
  await expect(banner).toContainText("Stopped by you");
  const said = await recordTexts(page, ["sentence", "release"]);
  const pid = consolePid();
  process.kill(pid, "SIGKILL");
  const age = page.getByTestId("loss-age");
  await expect(age).toBeVisible({ timeout: 60_000 });
  // However often it tries to connect, the age of the loss only grows; what was known before is dim.
  const ages: number[] = [];
  while ((await age.count()) > 0) {
    ages.push(parseFloat(await age.innerText({ timeout: 1000 }).catch(() => String(ages.at(-1)))));
    await page.waitForTimeout(200);
  }
  expect(ages).toEqual([...ages].sort((a, b) => a - b));
  await untilReplaced(pid);
  await untilLive(page);
  await expect(banner).toContainText("Stopped by you");
  await expect(banner).not.toContainText("browser of the console");
  // In all that time it never seemed to be released.
  expect(await said("sentence")).toEqual(["Stopped", "Link lost", "Unknown whether the robot is stopped", "Stopped"]);
  expect(await said("release")).toEqual(["Hold to release", "", "Hold to release"]);
  await page.reload();
  await untilLive(page);
  await expect(banner).toContainText("by this browser");
  await takeControl(page);
  expect(errors).toEqual([]);
});

test("a network that is cut while driving leaves the wheels at rest, and a stop that waits for a release", async ({ browser, context }) => {
  const network = await Network.open();
  const [driver, watcher] = [await context.newPage(), await (await browser.newContext()).newPage()];
  await openLive(watcher, "map");
  const errors = await openLive(driver, "teleop", network.url);
  await takeControl(driver);
  await drive(driver, "KeyQ");
  network.cut();
  await untilAtRest();
  await expect(watcher.getByTestId("stop")).toContainText("Stopped");
  await expect(driver.getByRole("alert").filter({ hasText: "No link." })).toBeVisible();
  network.mend();
  await untilLive(driver);
  await takeControl(driver);
  await expect(watcher.getByTestId("stop")).not.toContainText("Stopped");
  // The key is still held, but it drives only after it was let go.
  await staysAtRest(driver);
  await driver.keyboard.up("KeyQ");
  expect(errors).toEqual([]);
  network.close();
});

test("a page that falls asleep while driving leaves the wheels at rest, and drives nothing when it wakes", async ({ browser, context }) => {
  const [page, watcher] = [await context.newPage(), await (await browser.newContext()).newPage()];
  await openLive(watcher, "logs");
  const errors = await openLive(page, "teleop");
  await takeControl(page);
  await drive(page, "KeyQ");
  const wake = await fallAsleep(context, page);
  await untilAtRest();
  await expect(watcher.getByTestId("stop")).toContainText("Stopped");
  await wake();
  await untilLive(page);
  await staysAtRest(page);
  await page.keyboard.up("KeyQ");
  await takeControl(page);
  expect(errors).toEqual([]);
});

test("a tab that is hidden while driving stops the robot", async ({ context }) => {
  const page = await context.newPage();
  const errors = await openLive(page, "teleop");
  await takeControl(page);
  await drive(page, "KeyQ");
  // Playwright keeps every page visible and focused; without that, another tab hides this one.
  const session = await context.newCDPSession(page);
  await session.send("Emulation.setFocusEmulationEnabled", { enabled: false });
  const other = await context.newPage();
  await other.bringToFront();
  await untilAtRest();
  await page.bringToFront();
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await page.keyboard.up("KeyQ");
  await takeControl(page);
  expect(errors).toEqual([]);
});
