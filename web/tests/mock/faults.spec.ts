import { expect, test } from "@playwright/test";
import { TABS, openMock } from "../support/page";

for (const fault of ["nan", "empty", "none", "growing", "stalled", "nocamera", "skew"]) {
  test(`every tab survives the fault ${fault}`, async ({ page }) => {
    const errors = await openMock(page, "teleop", `state=mission&fault=${fault}`);
    for (const tab of TABS) {
      await page.locator(`#tab-${tab}`).click();
      await page.waitForTimeout(700);
      await expect(page.getByTestId("stop")).toBeVisible();
    }
    expect(errors).toEqual([]);
  });
}

test("ten thousand log lines a second leave the stop at hand", async ({ page }) => {
  const errors = await openMock(page, "logs", "state=calm&control=you&fault=logs");
  await page.waitForTimeout(3000);
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  expect(errors).toEqual([]);
});

test("a lost link says how old everything is, and that the robot's button works", async ({ page }) => {
  await openMock(page, "map", "state=lost");
  await expect(page.getByRole("alert")).toContainText("The button on the robot still works");
  await expect(page.getByText("Link lost")).toBeVisible();
});

test("forbidden storage does not keep the page from working", async ({ page }) => {
  await page.addInitScript(() => {
    Object.defineProperty(window, "localStorage", {
      get() {
        throw new DOMException("denied");
      },
    });
  });
  await page.goto("?mock=1&state=calm#teleop");
  await expect(page.getByTestId("stop")).toBeVisible();
  await expect(page.getByText("Nearest obstacle")).toBeVisible();
});

test("a robot that is lost on its map is named, and what helps", async ({ page }) => {
  const errors = await openMock(page, "map", "state=mission&fault=astray");
  await expect(page.getByTestId("sentence")).toHaveText("Lost on the map, waiting");
  await expect(page.getByText("Help it by correcting its position")).toBeVisible();
  expect(errors).toEqual([]);
});
