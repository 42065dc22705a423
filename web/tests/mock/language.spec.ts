import { expect, type Page, test } from "@playwright/test";
import { type Language, expectReadable, expectTabsReadable, openIn } from "../support/language";
import { hold } from "../support/page";

const HEIGHTS: Record<number, number> = { 390: 844, 768: 1024, 1440: 900, 1920: 1080 };

/** What opens over the page: by its keys, or by the button with this name. */
const DIALOGS: { name: string; open: (page: Page) => Promise<void> }[] = [
  { name: "keys", open: (page) => page.keyboard.press("?") },
  { name: "palette", open: (page) => page.keyboard.press("Control+k") },
  { name: "settings", open: (page) => page.getByRole("banner").getByRole("button").last().click() },
  { name: "control", open: (page) => page.getByTestId("control").click() },
  { name: "can I drive", open: (page) => page.locator("footer button").first().click() },
];

async function lookAtDialogs(page: Page, language: Language): Promise<void> {
  for (const { name, open } of DIALOGS) {
    await open(page);
    await page.getByRole("dialog").first().waitFor();
    await page.waitForTimeout(400);
    await expectReadable(page, language, name);
    await page.keyboard.press("Escape");
    await page.getByRole("dialog").first().waitFor({ state: "detached" });
  }
}

for (const language of ["en", "nl"] as const) {
  for (const width of [390, 768, 1440, 1920]) {
    test(`every text can be read at ${width} px in ${language}`, async ({ page }) => {
      await page.setViewportSize({ width, height: HEIGHTS[width] ?? 900 });
      await openIn(page, language, "teleop", "state=mission&control=phone");
      await expectTabsReadable(page, language);
      await lookAtDialogs(page, language);
      await openIn(page, language, "map", "state=stopped");
      await page.reload();
      await expectTabsReadable(page, language);
    });
  }
}

test("the page is there in English until its language can be loaded", async ({ page }) => {
  const dutch = "**/assets/dutch-*.js";
  await page.route(dutch, (route) => route.abort());
  await openIn(page, "nl", "teleop", "state=calm&control=free");
  await expect(page.getByText("Sticks are blocked")).toBeVisible();
  await hold(page, "release");
  await expect(page.getByText("Sticks are live")).toBeVisible();
  await page.unroute(dutch);
  await expectReadable(page, "nl", "teleop");
});
