import { expect, test } from "@playwright/test";
import { openMock } from "../support/page";

test("the heartbeats run in a worker of the page's own origin", async ({ page }) => {
  const worker = page.waitForEvent("worker");
  const errors = await openMock(page, "teleop", "state=calm&control=you");
  expect(new URL((await worker).url()).pathname).toMatch(/^\/page\/assets\/timer_worker-.*\.js$/);
  expect(errors).toEqual([]);
});

test("the screen stays on while the page has control", async ({ page }) => {
  await page.addInitScript(() => {
    const locks = { asked: 0, held: 0 };
    Object.assign(window, { locks });
    const request = () => {
      locks.asked += 1;
      locks.held += 1;
      const lock = { released: false, release: () => Promise.resolve(void ((lock.released = true), (locks.held -= 1))) };
      return Promise.resolve(lock);
    };
    Object.defineProperty(navigator, "wakeLock", { value: { request } });
  });
  const held = () => page.evaluate(() => (window as unknown as { locks: { held: number } }).locks.held);
  await openMock(page, "map", "state=calm&control=free");
  expect(await held()).toBe(0);
  await page.locator("header").getByRole("button", { name: "Nobody has control" }).click();
  await page.getByRole("button", { name: "Take control" }).click();
  await expect.poll(held).toBe(1);
  await page.getByRole("button", { name: "Give up control" }).click();
  await expect.poll(held).toBe(0);
});
