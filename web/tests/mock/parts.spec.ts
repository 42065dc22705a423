import { expect, test } from "@playwright/test";
import { TABS, hold, openMock } from "../support/page";

const CODE = /\/assets\/.*\.js$/;

test("a page that lost its server still shows every tab and drawer", async ({ page }) => {
  const errors = await openMock(page, "teleop", "state=calm&control=you");
  await expect(page.getByText("Nearest obstacle")).toBeVisible();
  await page.waitForTimeout(6000);
  await page.route(CODE, (route) => route.abort());
  for (const tab of TABS) {
    await page.locator(`#tab-${tab}`).click();
    await expect(page.locator("#view").getByText("Loading", { exact: true })).toHaveCount(0);
    await expect(page.locator("#view [role=alert]").filter({ hasText: "This part of the page failed" })).toHaveCount(0);
  }
  await page.keyboard.press("?");
  await expect(page.getByRole("dialog")).toBeVisible();
  expect(errors).toEqual([]);
});

test("a view whose code cannot be loaded yet is shown once the server is back", async ({ page }) => {
  await page.route(/\/assets\/logs_tab.*\.js$/, (route) => route.abort());
  await openMock(page, "teleop", "state=calm&control=you");
  await page.locator("#tab-logs").click();
  await expect(page.locator("#view").getByText("Loading", { exact: true })).toBeVisible();
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await page.unroute(/\/assets\/logs_tab.*\.js$/);
  await expect(page.locator("#view").getByText("Loading", { exact: true })).toHaveCount(0);
  await expect(page.locator("#view").getByRole("button").first()).toBeVisible();
});

test("a view that fails leaves the stop and the other views", async ({ page }) => {
  // The lidar's canvas has no drawing context: the view that draws it throws.
  await page.addInitScript(() => {
    HTMLCanvasElement.prototype.getContext = () => {
      throw new Error("no context here");
    };
  });
  await page.addInitScript(() => sessionStorage.setItem("lupin-booted", "1"));
  await page.goto("?mock=1&state=calm&control=you#teleop");
  await expect(page.getByTestId("stop")).toBeVisible();
  let failed = 0;
  for (const tab of TABS) {
    await page.locator(`#tab-${tab}`).click();
    await page.waitForTimeout(500);
    await expect(page.getByTestId("stop")).toBeVisible();
    failed += await page.locator("#view").getByText("This part of the page failed").count();
  }
  expect(failed).toBeGreaterThan(0);
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
});

test("keys drive no robot while a dialog is open, and what drives is let go of", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=free");
  await hold(page, "release");
  await expect(page.getByText("Sticks are live")).toBeVisible();
  const driving = page.getByText("+0.30 /", { exact: false });
  await page.keyboard.down("KeyW");
  await expect(driving.first()).toBeVisible();
  await page.keyboard.press("?");
  await expect(page.getByRole("dialog")).toBeVisible();
  await expect(driving).toHaveCount(0);
  await page.keyboard.up("KeyW");
  await page.keyboard.down("KeyW");
  await page.waitForTimeout(500);
  await expect(driving).toHaveCount(0);
  await page.keyboard.up("KeyW");
  await page.keyboard.press("Escape");
  await expect(page.getByRole("dialog")).toHaveCount(0);
  await page.keyboard.down("KeyW");
  await expect(driving.first()).toBeVisible();
  await page.keyboard.up("KeyW");
});

test("the palette takes what is typed right after its keys", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=you");
  await page.keyboard.press("Control+k");
  await page.keyboard.type("settings");
  await expect(page.getByRole("combobox")).toHaveValue("settings");
});

test("a view that could not be loaded is loaded by another try", async ({ page }) => {
  test.slow();
  await page.route(/\/assets\/logs_tab.*\.js$/, (route) => route.abort());
  await openMock(page, "teleop", "state=calm&control=you");
  await page.locator("#tab-logs").click();
  const again = page.locator("#view").getByRole("button", { name: "Try again" });
  await expect(again).toBeVisible({ timeout: 60_000 });
  await page.unroute(/\/assets\/logs_tab.*\.js$/);
  await again.click();
  await expect(again).toHaveCount(0);
  await expect(page.locator("#view").getByText("Loading", { exact: true })).toHaveCount(0);
  await expect(page.locator("#view").getByText("This part of the page failed")).toHaveCount(0);
});

test("another device gets an address of the network, a code, and its role", async ({ page }) => {
  const errors = await openMock(page, "map", "state=calm&control=free");
  const open = async () => {
    await page.keyboard.press("Control+k");
    await page.keyboard.type("open on another");
    await page.keyboard.press("Enter");
  };
  await open();
  const dialog = page.getByRole("dialog");
  await expect(dialog.getByRole("img", { name: "QR code of https://192.168.1.20:8090" })).toBeVisible();
  await expect(page.getByTestId("pairing-code")).toHaveText("K7Q2-MXPA");
  await dialog.getByRole("radio", { name: "Watch and stop" }).click();
  await expect(page.getByTestId("pairing-code")).toHaveText("W9RT-4HCN");
  await dialog.getByText("Other addresses of this console").click();
  await dialog.getByRole("button", { name: "https://greenhouse.local:8090" }).click();
  await expect(dialog.getByRole("img", { name: "QR code of https://greenhouse.local:8090" })).toBeVisible();
  expect(errors).toEqual([]);

  await openMock(page, "map", "state=calm&role=viewer");
  await open();
  await expect(dialog.getByRole("img", { name: "QR code of https://192.168.1.20:8090" })).toBeVisible();
  await expect(page.getByTestId("pairing-code")).toHaveCount(0);
});
