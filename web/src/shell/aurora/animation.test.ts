// @vitest-environment jsdom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LOOKS, type Look } from "./mood";
import { createShader } from "./shader";

vi.mock("./shader", () => ({ createShader: vi.fn() }));

const drawn: Look[] = [];
const release = vi.fn<() => void>();
let prefersStill = false;
let animate: typeof import("./animation").animate;

/** The page's pending animation frame, for tests that say when it comes. */
let pending: ((nowMs: number) => void)[] = [];
let nowMs = 1000;

function frames(count: number, periodMs: number): void {
  for (let frame = 0; frame < count; frame += 1) {
    nowMs += periodMs;
    for (const each of pending.splice(0)) each(nowMs);
  }
}

function takeFrames(): void {
  vi.stubGlobal("requestAnimationFrame", (draw: (nowMs: number) => void) => pending.push(draw));
  vi.stubGlobal("cancelAnimationFrame", () => (pending = []));
}

beforeEach(async () => {
  vi.useFakeTimers({ toFake: ["requestAnimationFrame", "cancelAnimationFrame", "performance"] });
  vi.stubGlobal("matchMedia", () => Object.assign(new EventTarget(), { matches: prefersStill }));
  vi.resetModules();
  ({ animate } = await import("./animation"));
  vi.mocked(createShader).mockReset().mockReturnValue({ draw: (look) => drawn.push(look), resize: () => {}, release });
  release.mockClear();
  drawn.length = 0;
  pending = [];
  prefersStill = false;
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the aurora", () => {
  it("drifts and ends", () => {
    const animation = animate(document.createElement("canvas"), LOOKS.calm);
    vi.advanceTimersByTime(1000);
    const calm = drawn.length;
    expect(calm).toBeGreaterThan(5);
    expect(calm).toBeLessThan(15);
    animation.show(LOOKS.stopped);
    vi.advanceTimersByTime(1000);
    expect(drawn.length - calm).toBeGreaterThan(20);
    expect(drawn.at(-1)?.stop).toBeLessThan(1);
    animation.end();
    const ended = drawn.length;
    vi.advanceTimersByTime(1000);
    expect(drawn.length).toBe(ended);
  });

  it("is dropped for good where frames take long, and gives its context back", () => {
    takeFrames();
    const canvas = document.createElement("canvas");
    const animation = animate(canvas, LOOKS.calm);
    frames(6, 208);
    expect([canvas.hidden, release.mock.calls.length, pending.length]).toEqual([true, 1, 0]);
    drawn.length = 0;
    animation.show(LOOKS.stopped);
    window.dispatchEvent(new Event("resize"));
    canvas.dispatchEvent(new Event("webglcontextlost"));
    document.dispatchEvent(new Event("visibilitychange"));
    frames(10, 16);
    animation.end();
    const next = document.createElement("canvas");
    animate(next, LOOKS.calm);
    frames(10, 16);
    expect([next.hidden, drawn.length]).toEqual([true, 0]);
    expect(createShader).toHaveBeenCalledOnce();
  });

  it("outlives a time in which the page is hidden", () => {
    takeFrames();
    const canvas = document.createElement("canvas");
    animate(canvas, LOOKS.calm);
    for (let turn = 0; turn < 10; turn += 1) {
      frames(3, 16);
      nowMs += 60_000;
      document.dispatchEvent(new Event("visibilitychange"));
    }
    frames(100, 16);
    expect([canvas.hidden, release.mock.calls.length]).toEqual([false, 0]);
  });

  it.each(["still", "software"])("is not drawn: %s", (reason) => {
    prefersStill = reason === "still";
    if (reason === "software") vi.mocked(createShader).mockReturnValue(null);
    const canvas = document.createElement("canvas");
    animate(canvas, LOOKS.calm).show(LOOKS.stopped);
    vi.advanceTimersByTime(1000);
    expect([canvas.hidden, drawn.length]).toEqual([true, 0]);
    expect(createShader).toHaveBeenCalledTimes(reason === "still" ? 0 : 1);
  });
});
