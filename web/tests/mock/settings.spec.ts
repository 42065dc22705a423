import { expect, test } from "@playwright/test";
import { hold, openMock } from "../support/page";

test("what belongs to this browser is kept over a reload, and takes no control", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=free");
  await page.getByRole("button", { name: "Settings" }).click();
  await page.getByRole("dialog").getByText("Light", { exact: true }).click();
  await page.getByRole("switch", { name: /Stop when this window loses the focus/ }).click();
  await expect(page.locator("html")).toHaveClass(/light/);
  await page.reload();
  await expect(page.locator("html")).toHaveClass(/light/);
  await page.getByRole("button", { name: "Settings" }).click();
  await expect(page.getByRole("switch", { name: /Stop when this window loses the focus/ })).not.toBeChecked();
  await page.keyboard.press("Escape");
  await expect(page.locator("header").getByText("Nobody has control")).toBeVisible();
});

test("settings of an earlier version are migrated", async ({ page }) => {
  await page.addInitScript(() => localStorage.setItem("lupin-hmi-settings/v3", JSON.stringify({ theme: "light", speedScale: 0.25, estopAutoOnFocusLoss: false })));
  await openMock(page, "teleop", "state=calm");
  await expect(page.locator("html")).toHaveClass(/light/);
  await expect(page.getByText("0.15 m/s, ", { exact: false })).toBeVisible();
  await page.getByRole("button", { name: "Settings" }).click();
  await expect(page.getByRole("switch", { name: /Stop when this window loses the focus/ })).toBeChecked();
});

test("a full storage changes nothing but how long a setting holds", async ({ page }) => {
  const errors = await openMock(page, "map", "state=calm&control=free");
  await page.evaluate(() => {
    Storage.prototype.setItem = () => {
      throw new DOMException("full", "QuotaExceededError");
    };
  });
  await page.getByRole("button", { name: "Settings" }).click();
  await page.getByRole("dialog").getByText("Light", { exact: true }).click();
  await expect(page.locator("html")).toHaveClass(/light/);
  await expect(page.getByRole("dialog").getByText("Kept until this page is closed", { exact: false })).toBeVisible();
  expect(errors).toEqual([]);
});

test("the log of what was sent has velocities, stops and calls", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=you");
  await hold(page, "release");
  await expect(page.getByText("Sticks are live")).toBeVisible();
  await page.keyboard.press("KeyW", { delay: 300 });
  await page.keyboard.press("Space");
  await page.getByRole("button", { name: "Settings" }).click();
  const log = page.getByRole("region", { name: "Sent by this page" });
  await expect(log).toContainText("/cmd_vel_manual");
  await expect(log).toContainText("/lupin/hmi/estop");
});

test("named locations of an earlier page move to the server", async ({ page }) => {
  const stored = () => page.evaluate(() => localStorage.getItem("lupin-hmi-settings/v4"));
  await openMock(page, "map", "state=calm&control=free");
  await page.evaluate(() => localStorage.setItem("lupin-hmi-settings/v4", JSON.stringify({ theme: "light", voiceNamedLocations: { "table 9": { x: 1, y: 2, yaw: 0 } } })));
  await page.reload();
  await expect.poll(stored).toBe('{"theme":"light"}');
  await expect(page.locator("header").getByText("Nobody has control")).toBeVisible();
  await page.keyboard.press("Control+k");
  await page.keyboard.type("table 9");
  await expect(page.getByRole("option", { name: /table 9/ })).toBeVisible();
});
