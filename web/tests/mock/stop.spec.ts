import { expect, test } from "@playwright/test";
import { hold, holdButton, openMock } from "../support/page";

test("starts with a closed gate, which only a held button opens", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=free");
  await expect(page.getByText("Sticks are blocked")).toBeVisible();
  await page.getByTestId("release").click();
  await expect(page.getByText("Sticks are blocked")).toBeVisible();
  await hold(page, "release");
  await expect(page.getByText("Sticks are live")).toBeVisible();
  await expect(page.getByText("You have control")).toBeVisible();
});

test("the space bar stops, and a release moves nothing without a new command", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=free");
  await hold(page, "release");
  await expect(page.getByText("Sticks are live")).toBeVisible();
  await page.keyboard.down("KeyW");
  await expect(page.getByText("+0.30 /", { exact: false }).first()).toBeVisible();
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(page.getByRole("status").filter({ hasText: "Stopped by you" })).toBeVisible();
  await expect(page.getByTestId("stop-age")).toContainText("ago");
  await hold(page, "release");
  await expect(page.getByTestId("stop")).not.toContainText("Stopped");
  await page.waitForTimeout(500);
  // The key was held all the time: it is dead until it was let go.
  await expect(page.getByText("+0.30 /", { exact: false })).toHaveCount(0);
  await page.keyboard.up("KeyW");
  await page.keyboard.down("KeyW");
  await expect(page.getByText("+0.30 /", { exact: false }).first()).toBeVisible();
  await page.keyboard.up("KeyW");
});

test("the space bar stops from every tab, also while a field has no focus", async ({ page }) => {
  await openMock(page, "logs", "state=calm&control=you");
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
});

test("a page that loses the focus while it has control stops", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=free");
  await hold(page, "release");
  await page.evaluate(() => window.dispatchEvent(new Event("blur")));
  await expect(page.getByTestId("stop")).toContainText("Stopped");
});

test("a watching page stops nothing by losing the focus", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=phone");
  await page.evaluate(() => window.dispatchEvent(new Event("blur")));
  await page.waitForTimeout(800);
  await expect(page.getByTestId("stop")).not.toContainText("Stopped");
});

test("a viewer can stop, and lets go of its own stop only", async ({ page }) => {
  await openMock(page, "teleop", "state=mission&role=viewer");
  await page.getByTestId("stop").click();
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(page.getByTestId("release")).toBeDisabled();
  const letGo = page.getByRole("button", { name: "Hold to let go of your stop" });
  await holdButton(page, letGo);
  await expect(letGo).toHaveCount(0);
  await expect(page.getByTestId("stop")).not.toContainText("Stopped");
  await openMock(page, "teleop", "state=stopped&role=viewer");
  await page.reload();
  await page.getByTestId("stop").click();
  await holdButton(page, letGo);
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(page.getByRole("status").filter({ hasText: "Stopped by phone-2" })).toBeVisible();
});

test("the top bar and the dialog of control show who is connected, and what each may do", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=phone");
  await expect(page.getByTestId("other-browsers")).toHaveText(/2.*Also connected: phone-2, tablet-1/);
  await page.getByRole("banner").getByRole("button", { name: /phone-2 has control/ }).click();
  await expect(page.getByTestId("browsers").getByRole("listitem")).toHaveText([
    /laptop-1 \(this browser\)\s*watches, may ask/,
    /phone-2\s*has control/,
    /tablet-1\s*watches only/,
  ]);
});

test("somebody who asks for control gets it from its holder", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=asked");
  await page.getByRole("button", { name: "Hand over" }).click();
  await expect(page.getByText("has control", { exact: false }).first()).toBeVisible();
  await expect(page.getByText("You have control")).toHaveCount(0);
});

test("what presses buttons for a person stops the robot, and confirms a release", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=you");
  await page.getByTestId("stop").evaluate((button: HTMLElement) => button.click());
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  const release = page.getByTestId("release");
  await release.evaluate((button: HTMLElement) => button.click());
  await expect(release).toHaveText("Press again to confirm");
  await page.waitForTimeout(600);
  await release.evaluate((button: HTMLElement) => button.click());
  await expect(page.getByTestId("stop")).not.toContainText("Stopped");
});

test("the space bar stops while a held button has the focus, and does not act on it", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=you");
  await hold(page, "release");
  const abort = page.getByRole("button", { name: "Hold to abort" });
  await abort.focus();
  await page.keyboard.down("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await page.waitForTimeout(2500);
  await page.keyboard.up("Space");
  await expect(abort).toHaveAttribute("data-times-held", "0");
  await expect(abort).toHaveText("Hold to abort");
});

test("a click without a pointer stops, and Enter on a held button acts", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=you");
  const release = page.getByTestId("release");
  await release.focus();
  await page.keyboard.down("Enter");
  await expect(page.getByText("Sticks are live")).toBeVisible();
  await page.keyboard.up("Enter");
  await page.getByTestId("stop").evaluate((button: HTMLElement) => button.click());
  await expect(page.getByText("Sticks are blocked")).toBeVisible();
  await expect(page.getByTestId("stop")).toContainText("Stopped");
});

test("a click into the report of a run stops nothing, and the space bar still does", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=you");
  await page.keyboard.press("Control+k");
  await page.keyboard.type("runs");
  await page.keyboard.press("Enter");
  await page.getByRole("button", { name: "Report", exact: true, disabled: false }).first().click();
  await page.locator("iframe").click();
  await page.waitForTimeout(800);
  await expect(page.getByTestId("stop")).not.toContainText("Stopped");
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
});

test("a stop says how far it has come, on a phone too", async ({ page }) => {
  await page.setViewportSize({ width: 390, height: 844 });
  await openMock(page, "map", "state=mission&control=you");
  const stop = page.getByTestId("stop");
  await expect(stop).toHaveAttribute("data-delivery", "ready");
  await stop.click();
  await expect(stop).toHaveAttribute("data-delivery", "stopped");
  await openMock(page, "map", "state=mission&control=you&fault=deaf");
  await page.reload();
  await stop.click();
  await expect(stop).toContainText("Stop sent");
  await expect(stop).toContainText("Not confirmed");
  await expect(stop.getByText("press the robot's button", { exact: true })).toBeVisible();
});

test("a stop that cannot be sent says so", async ({ page }) => {
  await openMock(page, "map", "state=lost&control=you");
  await expect(page.getByText("Link lost")).toBeVisible();
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Not sent");
  await expect(page.getByTestId("stop")).toContainText("press the robot's button");
});

test("the space bar stops from a field for a number, where it is no text", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=you");
  await page.getByPlaceholder("Tags to find").focus();
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
});

test("the mirrored stop beside the sticks stops, and shows what the bar shows", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=free");
  await hold(page, "release");
  await expect(page.getByText("Sticks are live")).toBeVisible();
  const mirrored = page.getByTestId("stop-mirrored");
  await expect(mirrored).toHaveAttribute("aria-pressed", "false");
  await mirrored.click();
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(mirrored).toContainText("Stopped");
  await expect(page.getByText("Sticks are blocked")).toBeVisible();
});
