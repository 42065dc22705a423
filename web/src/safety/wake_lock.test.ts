import { expect, it, vi } from "vitest";
import { ScreenOn } from "./wake_lock";

const settled = () => new Promise((resolve) => setTimeout(resolve, 0));

function browser() {
  const locks: { released: boolean; release: () => Promise<void> }[] = [];
  const request = vi.fn<(kind: string) => Promise<unknown>>(() => {
    const lock = { released: false, release: () => Promise.resolve(void (lock.released = true)) };
    locks.push(lock);
    return Promise.resolve(lock);
  });
  return { locks, request, wakeLock: { request } as unknown as WakeLock };
}

it("the screen stays on while the page commands, and is let go of afterwards", async () => {
  const { locks, wakeLock } = browser();
  const screen = new ScreenOn(wakeLock);
  screen.want(true);
  screen.want(true);
  await settled();
  expect(locks.length).toBe(1);
  screen.want(false);
  await settled();
  expect(locks[0]?.released).toBe(true);
});

it("a page that is shown again asks again", async () => {
  const { locks, wakeLock } = browser();
  const screen = new ScreenOn(wakeLock);
  screen.shownAgain();
  screen.want(true);
  await settled();
  locks[0]!.released = true;
  screen.shownAgain();
  await settled();
  expect(locks.length).toBe(2);
});

it("a refused lock changes nothing", async () => {
  const screen = new ScreenOn({ request: () => Promise.reject(new Error("battery")) } as unknown as WakeLock);
  screen.want(true);
  screen.want(false);
  await settled();
});
