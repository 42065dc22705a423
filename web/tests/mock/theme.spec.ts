import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { expect, test } from "@playwright/test";
import { TABS, openMock } from "../support/page";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

test("the light theme is light, readable on every tab, and leaves the map dark", async ({ page }) => {
  const errors = await openMock(page, "map", "state=mission&control=you");
  await page.getByRole("button", { name: "Settings" }).click();
  await page.getByRole("dialog").getByText("Light", { exact: true }).click();
  await page.keyboard.press("Escape");
  const brightness = (selector: string) =>
    page.locator(selector).first().evaluate((element) => {
      const context = document.createElement("canvas").getContext("2d");
      if (context === null) throw new Error("no canvas");
      context.fillStyle = getComputedStyle(element).backgroundColor;
      context.fillRect(0, 0, 1, 1);
      return Math.max(...context.getImageData(0, 0, 1, 1).data.slice(0, 3));
    });
  await expect.poll(() => brightness("body")).toBeGreaterThan(200);
  expect(await brightness(".dark-island")).toBeLessThan(60);
  await page.evaluate(AXE);
  for (const tab of TABS) {
    await page.locator(`#tab-${tab}`).click();
    await page.waitForTimeout(800);
    const found = await page.evaluate(async () => {
      const { axe } = window as unknown as { axe: { run: () => Promise<{ violations: { id: string; nodes: { html: string }[] }[] }> } };
      return (await axe.run()).violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html.slice(0, 160)).join(" | ")}`);
    });
    expect([tab, found]).toEqual([tab, []]);
  }
  expect(errors).toEqual([]);
});

for (const state of ["calm", "stopped", "lost", "stale"]) {
  test(`the light theme has enough contrast while the robot is ${state}`, async ({ page }) => {
    await page.addInitScript(() => localStorage.setItem("lupin-hmi-settings/v5", JSON.stringify({ theme: "light" })));
    await openMock(page, "teleop", `state=${state}&control=you`);
    await expect(page.locator("html")).toHaveClass(/light/);
    await page.evaluate(AXE);
    for (const tab of TABS) {
      await page.locator(`#tab-${tab}`).click();
      await page.waitForTimeout(800);
      const found = await page.evaluate(async () => {
        const { axe } = window as unknown as { axe: { run: (options: object) => Promise<{ violations: { nodes: { html: string; any: { message: string }[] }[] }[] }> } };
        const { violations } = await axe.run({ runOnly: ["color-contrast"] });
        return violations.flatMap(({ nodes }) => nodes.map(({ html, any }) => `${html.slice(0, 200)}: ${any[0]?.message}`));
      });
      expect([tab, found]).toEqual([tab, []]);
    }
  });
}
