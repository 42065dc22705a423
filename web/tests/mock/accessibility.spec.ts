import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { type Page, expect, test } from "@playwright/test";
import { TABS, hold, openMock } from "../support/page";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

interface Violation {
  id: string;
  nodes: { html: string; failureSummary?: string }[];
}

async function findViolations(page: Page): Promise<string[]> {
  await page.evaluate(AXE);
  const violations = await page.evaluate(async () => {
    const { axe } = window as unknown as { axe: { run: () => Promise<{ violations: Violation[] }> } };
    return (await axe.run()).violations;
  });
  return violations.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html.slice(0, 160)).join(" | ")}`);
}

for (const tab of TABS) {
  for (const state of ["calm", "mission", "stopped", "lost"]) {
    test(`axe finds nothing on ${tab}, ${state}`, async ({ page }) => {
      const errors = await openMock(page, tab, `state=${state}`);
      await page.waitForTimeout(1500);
      const found = await findViolations(page);
      expect(found).toEqual([]);
      expect(errors).toEqual([]);
    });
  }
}

for (const [tab, state] of [["map", "stale"], ["teleop", "stale"], ["telemetry", "stale"], ["map", "lost"], ["arm", "calm"]] as const) {
  test(`live regions announce no ages on ${tab}, ${state}`, async ({ page }) => {
    await openMock(page, tab, `state=${state}&control=you`);
    await page.waitForTimeout(9000);
    const announced = () =>
      page.evaluate(() =>
        [...document.querySelectorAll("[role=status], [role=alert], [aria-live]")].map((region) => {
          const copy = region.cloneNode(true) as Element;
          for (const hidden of copy.querySelectorAll("[aria-hidden=true]")) hidden.remove();
          return copy.textContent;
        }),
      );
    const before = await announced();
    await page.waitForTimeout(1500);
    expect(await announced()).toEqual(before);
  });
}

const byPalette = (command: string) => async (page: Page) => {
  await page.keyboard.press("Control+k");
  await page.keyboard.type(command);
  await page.keyboard.press("Enter");
};

const DIALOGS: Record<string, { tab?: string; open: (page: Page) => Promise<void> }> = {
  settings: { open: (page) => page.getByRole("button", { name: "Settings" }).click() },
  palette: { open: (page) => page.keyboard.press("Control+k") },
  doctor: { open: byPalette("run the doctor") },
  runs: { open: byPalette("runs") },
  share: { open: byPalette("open on another") },
  control: { open: (page) => page.locator("header").getByRole("button", { name: "You have control" }).click() },
  keys: { open: (page) => page.keyboard.press("?") },
  obstacles: { open: (page) => page.getByRole("button", { name: "Can I drive?" }).click() },
  calibration: {
    tab: "arm",
    open: async (page) => {
      await hold(page, "release");
      await page.getByRole("button", { name: "Calibrate", exact: true }).click();
    },
  },
  record: {
    tab: "arm",
    open: async (page) => {
      await hold(page, "release");
      await page.getByRole("button", { name: "Record", exact: true }).click();
    },
  },
};

for (const [name, { tab = "map", open }] of Object.entries(DIALOGS)) {
  test(`axe finds nothing in the dialog ${name}, and Tab stays in it`, async ({ page }) => {
    const errors = await openMock(page, tab, "state=calm&control=you");
    await page.waitForTimeout(500);
    await open(page);
    const dialog = page.getByRole("dialog");
    await expect(dialog).toBeVisible();
    await page.waitForTimeout(1000);
    expect(await findViolations(page)).toEqual([]);
    const reached = new Set<string>();
    for (let press = 0; press < 60; press += 1) {
      await page.keyboard.press("Tab");
      reached.add(
        await page.evaluate(() => (document.activeElement?.closest("[role=dialog]") ? "dialog" : document.activeElement?.closest("[data-stop]") ? "stop" : `elsewhere: ${document.activeElement?.outerHTML.slice(0, 120)}`)),
      );
    }
    expect([...reached].toSorted()).toEqual(["dialog", "stop"]);
    expect(errors).toEqual([]);
  });
}
