import { afterEach, beforeEach, expect, it, vi } from "vitest";

const isSoftware = vi.hoisted(() => ({ value: true }));
vi.mock("@/widgets/webgl", () => ({ drawsInSoftware: () => isSoftware.value }));

/** Animation frames of a page that each frame of the scene holds up. */
let pending: (() => void)[] = [];
let nowMs = 0;

function animationFrames(count: number, periodMs: number): void {
  for (let frame = 0; frame < count; frame += 1) {
    nowMs += periodMs;
    for (const each of pending.splice(0)) each();
  }
}

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
  vi.resetModules();
  pending = [];
  nowMs = 1000;
  vi.stubGlobal("requestAnimationFrame", (callback: () => void) => pending.push(callback));
  vi.spyOn(performance, "now").mockImplementation(() => nowMs);
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

it("draws once for all data of a period, for the canvas that asked last", async () => {
  const { requestFrame } = await import("./frames");
  const [old, shown] = [vi.fn(), vi.fn()];
  requestFrame(old);
  requestFrame(shown);
  requestFrame(shown);
  vi.advanceTimersByTime(0);
  expect([old.mock.calls.length, shown.mock.calls.length]).toEqual([0, 1]);
  requestFrame(shown);
  vi.advanceTimersByTime(32);
  expect(shown).toHaveBeenCalledTimes(1);
  vi.advanceTimersByTime(3);
  expect(shown).toHaveBeenCalledTimes(2);
});

it.each([
  [true, 120],
  [false, 34],
])("waits longer between frames that hold the page up, if the CPU draws them: %s", async (software, periodMs) => {
  isSoftware.value = software;
  const { isSlow, measureFrame, requestFrame } = await import("./frames");
  for (let drawn = 0; drawn < 40; drawn += 1) {
    measureFrame();
    animationFrames(1, 60);
    animationFrames(2, 1000 / 60);
  }
  expect(isSlow()).toBe(software);
  const draw = vi.fn();
  requestFrame(draw);
  vi.advanceTimersByTime(0);
  requestFrame(draw);
  vi.advanceTimersByTime(periodMs - 3);
  expect(draw).toHaveBeenCalledTimes(1);
  vi.advanceTimersByTime(5);
  expect(draw).toHaveBeenCalledTimes(2);
});
