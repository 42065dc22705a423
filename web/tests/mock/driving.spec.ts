import { type Page, expect, test } from "@playwright/test";
import { TABS, hold, openMock } from "../support/page";

async function holdStick(page: Page): Promise<void> {
  const stick = await page.getByRole("application", { name: "Move" }).boundingBox();
  if (stick === null) throw new Error("not on the page");
  await page.mouse.move(stick.x + stick.width / 2, stick.y + stick.height / 2);
  await page.mouse.down();
  await page.mouse.move(stick.x + stick.width / 2, stick.y + stick.height * 0.2);
}

test("a stick that is held while the tab changes is let go of", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=free");
  await hold(page, "release");
  await holdStick(page);
  await expect(page.getByTestId("sentence")).toHaveText("Driving by hand");
  await page.keyboard.press("7");
  await expect(page.locator("#tab-map")).toHaveAttribute("aria-selected", "true");
  await expect(page.getByTestId("sentence")).not.toHaveText("Driving by hand");
  await page.keyboard.press("1");
  await page.waitForTimeout(1000);
  await expect(page.getByTestId("sentence")).not.toHaveText("Driving by hand");
  await page.mouse.up();
});

test("a key that is let go while Cmd or a menu is open does not drive on", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=free");
  await hold(page, "release");
  for (const end of [() => page.keyboard.press("Meta"), () => page.evaluate(() => window.dispatchEvent(new MouseEvent("contextmenu")))]) {
    await page.keyboard.down("KeyW");
    await expect(page.getByTestId("sentence")).toHaveText("Driving by hand");
    await end();
    await expect(page.getByTestId("sentence")).not.toHaveText("Driving by hand");
    await page.keyboard.up("KeyW");
  }
});

test("a space bar after a hold that was let go early stops the robot", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=you");
  await hold(page, "release");
  await page.getByRole("button", { name: "Hold to abort" }).click();
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
});

test("a stick that is held while its view fails is let go of", async ({ page }) => {
  await openMock(page, "teleop", "state=calm&control=free");
  await hold(page, "release");
  await holdStick(page);
  await expect(page.getByTestId("sentence")).toHaveText("Driving by hand");
  await page.evaluate(() => {
    const { toFixed } = Number.prototype;
    const failing = function (this: number, places?: number): string {
      if (new Error().stack?.includes("teleop_tab")) throw new Error("no numbers here");
      return toFixed.call(this, places);
    };
    Object.assign(Number.prototype, { toFixed: failing });
  });
  await expect(page.locator("#view").getByText("This part of the page failed")).toBeVisible();
  await expect(page.getByTestId("sentence")).not.toHaveText("Driving by hand");
  await page.mouse.up();
});

test("a page that takes control does not hold a mission that drives", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=free");
  const sentence = page.getByTestId("sentence");
  await expect(sentence).toContainText("tag");
  await page.locator("header").getByRole("button", { name: "Nobody has control" }).click();
  await page.getByRole("button", { name: "Take control" }).click();
  await page.keyboard.press("Escape");
  await expect(page.getByText("You have control").first()).toBeVisible();
  await page.waitForTimeout(2000);
  await expect(sentence).toContainText("tag");
  await expect(page.getByTestId("wheels-held")).toHaveCount(0);
});

test("a page that holds the wheels against a mission says so on every tab", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=you&fault=deaf");
  await expect(page.getByTestId("sentence")).toContainText("tag");
  await page.keyboard.press("Space");
  for (const tab of TABS) {
    await page.locator(`#tab-${tab}`).click();
    await expect(page.getByTestId("wheels-held")).toContainText("This page holds the wheels");
    await expect(page.getByTestId("sentence")).toHaveText("This page holds the wheels");
  }
});

test("a mission is neither started nor resumed through a closed gate", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=you");
  const start = page.getByTestId("start-mission");
  await expect(page.getByText("hold “Hold to start driving” first", { exact: false }).first()).toBeVisible();
  await expect(start).toBeDisabled();
  await hold(page, "release");
  await expect(start).toBeEnabled();
});

test("the palette and the map's Enter key do not pass by the obstacles of the buttons", async ({ page }) => {
  await openMock(page, "map", "state=calm&control=you");
  await page.keyboard.press("Control+k");
  await page.keyboard.type("home");
  for (const option of await page.getByRole("dialog").getByRole("option").all()) await expect(option).toHaveAttribute("aria-disabled", "true");
  await page.keyboard.press("Escape");
  const surface = page.locator("[aria-describedby=map-keys]");
  await surface.focus();
  await page.keyboard.press("g");
  await expect(page.getByTestId("send-pose")).toBeDisabled();
  await page.keyboard.press("Enter");
  await page.waitForTimeout(500);
  await expect(page.getByTestId("send-pose")).toBeVisible();
  await hold(page, "release");
  await expect(page.getByTestId("send-pose")).toBeEnabled();
  await surface.focus();
  await page.keyboard.press("Enter");
  await expect(page.getByTestId("send-pose")).toHaveCount(0);
});

test("a stick overrides a mission, and the view says so", async ({ page }) => {
  await openMock(page, "teleop", "state=mission&control=you");
  await hold(page, "release");
  await expect(page.getByText("Sticks are live: they override the mission")).toBeVisible();
  await holdStick(page);
  await expect(page.getByTestId("sentence")).toHaveText("Driven by hand; the mission waits");
  await page.mouse.up();
  await expect(page.getByTestId("sentence")).toContainText("tag");
});

test("the robot is not relocated while a mission drives it", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=you");
  await page.getByRole("button", { name: "Correct the robot's position" }).first().click();
  const map = await page.locator("[aria-describedby=map-keys]").boundingBox();
  if (map === null) throw new Error("not on the page");
  await page.mouse.click(map.x + map.width / 2, map.y + map.height / 2);
  await expect(page.getByText("the mission is driving", { exact: false }).first()).toBeVisible();
  await expect(page.getByTestId("send-pose")).toBeDisabled();
});

test("what ends or replaces a running mission is held or confirmed, and is not offered against the stop", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=you");
  await hold(page, "release");
  const sentence = page.getByTestId("sentence");
  const dock = page.getByRole("button", { name: "Hold to stop inspecting and dock" });
  const skip = page.getByRole("button", { name: /^Hold to skip tag/ });
  await expect(dock).toHaveAttribute("title", /Interrupts the mission/);
  const before = await skip.textContent();
  await dock.click();
  await skip.click();
  // A command of the palette that ends something is chosen twice; a key that is held, or a double click, is one choice.
  await page.keyboard.press("Control+k");
  await page.keyboard.type("abort");
  const option = page.getByRole("option", { name: /Abort the mission/ });
  await option.dblclick();
  await expect(option).toContainText("Choose it again to confirm");
  await page.keyboard.press("Escape");
  await expect(skip).toHaveText(before ?? "");
  await expect(sentence).not.toContainText("dock");
  await page.keyboard.press("Space");
  await expect(dock).toBeDisabled();
  await expect(dock).toHaveAttribute("title", "release the stop first");
  await hold(page, "release");
  await expect(dock).toBeEnabled();
  await page.keyboard.press("Control+k");
  await page.keyboard.type("abort");
  await option.click();
  await page.waitForTimeout(500);
  await option.click();
  await expect(page.getByRole("dialog")).toHaveCount(0);
  await expect(skip).toHaveCount(0);
});
