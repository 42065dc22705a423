import { type Locator, type Page, expect } from "@playwright/test";

export const TABS = ["teleop", "arm", "voice", "cameras", "telemetry", "logs", "map"] as const;

/** Open a tab of the page in mock mode, without the boot handshake. Every error of the page fails the test at its end. */
export async function openMock(page: Page, tab: string, query = ""): Promise<string[]> {
  const errors: string[] = [];
  page.on("pageerror", (error) => errors.push(error.message));
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  await page.addInitScript(() => sessionStorage.setItem("lupin-booted", "1"));
  await page.goto(`?mock=1${query === "" ? "" : `&${query}`}#${tab}`);
  await expect(page.getByTestId("stop")).toBeVisible();
  return errors;
}

/** Hold a button that acts only after it was held. */
export async function hold(page: Page, testId: string): Promise<void> {
  await holdButton(page, page.getByTestId(testId));
}

/** A button acts after 1.2 s, but the page's timers are late on a busy machine. */
const HELD_MS = 3000;

export async function holdButton(page: Page, button: Locator): Promise<void> {
  await button.hover();
  await page.mouse.down();
  await page.waitForTimeout(HELD_MS);
  await page.mouse.up();
}
