import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { type Page, expect, test } from "@playwright/test";
import { openMock } from "../support/page";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

/** Open a tab with something recorded, and rewind it. */
async function openRewound(page: Page, tab: string, query = "state=mission&control=you"): Promise<string[]> {
  const errors = await openMock(page, tab, query);
  await page.waitForTimeout(3500);
  await page.keyboard.press("r");
  await expect(page.getByTestId("rewind-bar")).toBeVisible();
  return errors;
}

/** What is drawn on the map, but for labels of ages. */
const pixels = (page: Page) => page.evaluate(() => (document.querySelector("[data-testid=map-canvas] canvas") as HTMLCanvasElement).toDataURL());

test("the map shows a moment of the recording, stands still, and goes back to live by one key", async ({ page }) => {
  const errors = await openRewound(page, "map");
  await page.getByRole("slider", { name: "Shown moment" }).focus();
  await page.keyboard.press("Home");
  await expect(page.getByText("Reading the recording")).toBeHidden();
  await page.waitForTimeout(700);
  const first = await pixels(page);
  await page.waitForTimeout(1000);
  expect(await pixels(page)).toBe(first);
  await page.keyboard.press("End");
  await page.waitForTimeout(700);
  expect(await pixels(page)).not.toBe(first);
  await page.keyboard.press("l");
  await expect(page.getByTestId("rewind-bar")).toBeHidden();
  await page.waitForTimeout(500);
  const live = await pixels(page);
  await page.waitForTimeout(1000);
  expect(await pixels(page)).not.toBe(live);
  expect(errors).toEqual([]);
});

test("the recording plays, and holds", async ({ page }) => {
  await openRewound(page, "map");
  const slider = page.getByRole("slider", { name: "Shown moment" });
  await slider.focus();
  await page.keyboard.press("Home");
  const moment = async () => Number(await slider.getAttribute("aria-valuenow"));
  const start = await moment();
  await page.getByTestId("rewind-play").click();
  await expect.poll(moment).toBeGreaterThan(start + 0.5);
  await page.getByTestId("rewind-play").click();
  const held = await moment();
  await page.waitForTimeout(500);
  expect(await moment()).toBe(held);
});

test("the cameras show the images of the moment, with the time they were taken", async ({ page }) => {
  const errors = await openRewound(page, "cameras");
  await page.getByRole("slider", { name: "Shown moment" }).focus();
  await page.keyboard.press("End");
  await expect(page.getByText(/^image of /).first()).toBeVisible();
  const size = await page.evaluate(() => {
    const canvas = document.querySelector("section canvas[role=img]") as HTMLCanvasElement;
    return [canvas.width, canvas.height];
  });
  expect(size[0]).toBeGreaterThan(1);
  await page.getByTestId("go-live").click();
  await expect(page.getByText(/fps/).first()).toBeVisible();
  expect(errors).toEqual([]);
});

test("a rewound page sends no command, and its stop stops and goes back to live", async ({ page }) => {
  const errors = await openRewound(page, "map");
  await expect(page.getByRole("button", { name: "Send a goal", exact: false })).toHaveCount(0);
  await expect(page.getByTestId("release")).toBeHidden();
  await page.keyboard.press("Control+k");
  await page.keyboard.type("pause");
  await page.keyboard.press("Enter");
  await page.keyboard.press("Escape");
  await expect(page.getByTestId("rewind-bar")).toBeVisible();
  await expect(page.getByTestId("stop")).not.toContainText("Stopped");
  await page.keyboard.press("Space");
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(page.getByTestId("rewind-bar")).toBeHidden();
  expect(errors).toEqual([]);
});

test("leaving for a view without a past goes back to live", async ({ page }) => {
  await openRewound(page, "map");
  await page.locator("#tab-cameras").click();
  await expect(page.getByTestId("rewind-bar")).toBeVisible();
  await page.locator("#tab-teleop").click();
  await expect(page.getByTestId("rewind-bar")).toBeHidden();
});

test("a page with nothing recorded stays live and says why", async ({ page }) => {
  await openMock(page, "map", "state=mission&clock=12");
  await page.keyboard.press("r");
  await expect(page.getByRole("alert").filter({ hasText: "nothing is recorded yet" })).toBeVisible();
  await expect(page.getByTestId("rewind-bar")).toBeHidden();
});

for (const [tab, width] of [["map", 1440], ["map", 390], ["cameras", 768]] as const) {
  test(`a rewound page fits and axe finds nothing: ${tab} at ${width} px`, async ({ page }) => {
    await page.setViewportSize({ width, height: width < 768 ? 844 : 1000 });
    const errors = await openRewound(page, tab);
    await page.waitForTimeout(1000);
    expect(await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth)).toBe(0);
    await page.evaluate(AXE);
    const found = await page.evaluate(async () => {
      const { axe } = window as unknown as { axe: { run: () => Promise<{ violations: { id: string; nodes: { html: string }[] }[] }> } };
      return (await axe.run()).violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html.slice(0, 160)).join(" | ")}`);
    });
    expect(found).toEqual([]);
    expect(errors).toEqual([]);
  });
}
