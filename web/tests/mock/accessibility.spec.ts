import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { expect, test } from "@playwright/test";
import { TABS, openMock } from "../support/page";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

interface Violation {
  id: string;
  nodes: { html: string; failureSummary?: string }[];
}

for (const tab of TABS) {
  for (const state of ["calm", "mission", "stopped", "lost"]) {
    test(`axe finds nothing on ${tab}, ${state}`, async ({ page }) => {
      const errors = await openMock(page, tab, `state=${state}`);
      await page.waitForTimeout(1500);
      await page.evaluate(AXE);
      const violations = await page.evaluate(async () => {
        const { axe } = window as unknown as { axe: { run: () => Promise<{ violations: Violation[] }> } };
        return (await axe.run()).violations;
      });
      const found = violations.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html.slice(0, 160)).join(" | ")}`);
      expect(found).toEqual([]);
      expect(errors).toEqual([]);
    });
  }
}
