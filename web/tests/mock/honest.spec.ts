import { expect, test } from "@playwright/test";
import { hold, openMock } from "../support/page";

test("a goal that navigation drives to is not called standing still", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=you");
  const sentence = page.getByTestId("sentence");
  const canDrive = page.getByRole("button", { name: "Can I drive?" });
  await hold(page, "release");
  await expect(sentence).toHaveText("Ready for a mission");
  await expect(canDrive).toContainText("the robot stops within 0.5 s");
  const surface = page.locator("[aria-describedby=map-keys]");
  await surface.focus();
  await page.keyboard.press("g");
  for (let step = 0; step < 15; step += 1) await page.keyboard.press("ArrowRight");
  await expect(page.getByTestId("send-pose")).toBeEnabled();
  await page.keyboard.press("Enter");
  await expect(sentence).toHaveText("Driving to a goal");
  await expect(canDrive).toContainText("let go and it drives on to its goal");
  await expect(sentence).toHaveText("Ready for a mission");
  await expect(canDrive).toContainText("the robot stops within 0.5 s");
});

test("a lost link is dim everywhere, and its age only grows", async ({ page }) => {
  await openMock(page, "teleop", "state=lost&control=you");
  const age = page.getByTestId("loss-age");
  await expect(page.getByText("Link lost")).toBeVisible();
  await expect(page.getByText("You had control").first()).toBeVisible();
  await expect(page.getByText("You have control")).toHaveCount(0);
  await expect(page.getByTestId("control")).not.toHaveClass(/bg-alive-wash/);
  await expect(page.getByTestId("battery-age")).toContainText("ago");
  const ages: number[] = [];
  for (let sample = 0; sample < 12; sample += 1) {
    ages.push(parseFloat(await age.innerText()));
    await page.waitForTimeout(500);
  }
  expect(ages).toEqual([...ages].sort((a, b) => a - b));
  expect(ages.at(-1)).toBeGreaterThan(4);
});

test("the torque's switch and the line beside it say the same, and nothing of the joints is cut off", async ({ page }) => {
  await page.setViewportSize({ width: 1440, height: 900 });
  await openMock(page, "arm", "state=stopped");
  const panel = page.getByRole("region", { name: "Torque" });
  const isWhole = () => page.getByRole("button", { name: "Calibrate" }).evaluate((button) => {
    const column = button.closest(".lg\\:overflow-y-auto");
    return column !== null && column.scrollHeight <= column.clientHeight + 1;
  });
  // A limp arm may be enabled while the robot is stopped: that holds it where it is.
  await expect(panel).toContainText("enabled, the arm is held where it is");
  await expect(panel).not.toContainText("cannot be switched");
  expect(await isWhole()).toBe(true);
  await panel.getByRole("button", { name: "Enable" }).click();
  // A stiff one would sink.
  await expect(panel.getByRole("button", { name: "Hold to disable" })).toBeDisabled();
  await expect(panel).toContainText("Torque cannot be switched: the robot is stopped");
  expect(await isWhole()).toBe(true);
});

test("a color that a stop keeps from being shown is not said to be on the strip", async ({ page }) => {
  await openMock(page, "map", "state=stopped&control=you");
  await page.getByRole("tab", { name: "Lights" }).click();
  const status = page.getByRole("status").filter({ hasText: /color was set|confirmed/ });
  await expect(status).not.toContainText("Not shown");
  await page.getByRole("button", { name: "Blue", exact: true }).click();
  await expect(status).toContainText("Blue, confirmed");
  await expect(status).toContainText("Not shown while this lasts: e-stop or fault");
});
