import { expect, test } from "@playwright/test";
import { TABS, openMock } from "../support/page";

for (const width of [390, 768, 1440, 1920]) {
  test(`nothing reaches past the window at ${width} px, and the stop is on it`, async ({ page }) => {
    await page.setViewportSize({ width, height: width < 768 ? 844 : 1000 });
    await openMock(page, "teleop", "state=mission");
    for (const tab of TABS) {
      await page.locator(`#tab-${tab}`).click();
      await page.waitForTimeout(500);
      const overflow = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      expect([tab, overflow]).toEqual([tab, 0]);
      const stop = await page.getByTestId("stop").boundingBox();
      expect(stop).not.toBeNull();
      expect((stop?.x ?? 0) + (stop?.width ?? 0)).toBeLessThanOrEqual(width);
      expect(Math.min(stop?.width ?? 0, stop?.height ?? 0)).toBeGreaterThanOrEqual(64);
    }
  });
}

test("touch targets are at least 44 px high on a phone", async ({ page }) => {
  await page.setViewportSize({ width: 390, height: 844 });
  await openMock(page, "teleop", "state=calm");
  for (const tab of TABS) {
    await page.locator(`#tab-${tab}`).click();
    await page.waitForTimeout(500);
    const small = await page.evaluate(() =>
      [...document.querySelectorAll("button:not([disabled])")]
        .filter((button) => button.checkVisibility())
        .map((button) => ({ name: button.getAttribute("aria-label") ?? button.textContent, box: button.getBoundingClientRect() }))
        .filter(({ box }) => box.height > 0 && box.height < 43.5)
        .map(({ name, box }) => `${name}: ${box.height}`),
    );
    expect([tab, small]).toEqual([tab, []]);
  }
});

test("both languages have every tab", async ({ page }) => {
  await openMock(page, "map", "state=calm");
  await page.getByRole("button", { name: "Settings" }).click();
  await page.getByText("Nederlands").click();
  await page.keyboard.press("Escape");
  await expect(page.locator("#tab-map:visible")).toContainText("Kaart");
});
