import { type Locator, type Page, expect } from "@playwright/test";

export { TAB_IDS as TABS } from "../../src/state/tab_ids";

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

/** Hold until the button has acted, however late the page's timers are. A button that is gone or has another name has acted, too. */
export async function holdButton(page: Page, button: Locator): Promise<void> {
  const timesHeld = () => button.evaluateAll((elements) => elements[0]?.getAttribute("data-times-held") ?? "gone");
  await button.hover();
  const before = await timesHeld();
  await page.mouse.down();
  await expect.poll(timesHeld, { message: "the held button acts" }).not.toBe(before);
  await page.mouse.up();
}
