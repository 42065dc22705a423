import { expect, test } from "@playwright/test";
import { hold, openMock } from "../support/page";

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
  await page.keyboard.down("KeyW");
  await expect(page.getByText("+0.30 /", { exact: false }).first()).toBeVisible();
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(page.getByRole("status").filter({ hasText: "Stopped:" })).toBeVisible();
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

test("a viewer can stop and cannot release", async ({ page }) => {
  await openMock(page, "teleop", "state=mission&role=viewer");
  await page.getByTestId("stop").click();
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(page.getByTestId("release")).toBeDisabled();
});

test("somebody who asks for control gets it from its holder", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=asked");
  await page.getByRole("button", { name: "Hand over" }).click();
  await expect(page.getByText("has control", { exact: false }).first()).toBeVisible();
  await expect(page.getByText("You have control")).toHaveCount(0);
});
