import { describe, expect, it } from "vitest";
import { FramePacer, WATCHED_FRAMES } from "./pacing";

/** A pacer that saw many frames of which each held the page up for `heldMs`. */
function after(heldMs: number): FramePacer {
  const pacer = new FramePacer();
  for (let frame = 0; frame < 60; frame += 1) pacer.measured(0, (WATCHED_FRAMES - 1) * (1000 / 60) + heldMs);
  return pacer;
}

describe("the pace of the scene", () => {
  it("is as fast as data comes where frames cost nothing", () => {
    expect(new FramePacer().periodMs).toBeCloseTo(33.3, 0);
    expect(after(0).periodMs).toBeCloseTo(33.3, 0);
    expect(after(16).isSlow).toBe(false);
  });

  it.each([20, 40, 60])("leaves the page 30 frames a second where each frame holds it up for %d ms", (heldMs) => {
    const { periodMs } = after(heldMs);
    const framesInPeriod = 1 + (periodMs - heldMs) / (1000 / 60);
    expect((1000 * framesInPeriod) / periodMs).toBeGreaterThanOrEqual(30);
  });

  it("never stops, and recovers when frames become cheap", () => {
    const pacer = after(5000);
    expect(pacer.periodMs).toBe(250);
    expect(pacer.isSlow).toBe(true);
    for (let frame = 0; frame < 60; frame += 1) pacer.measured(0, WATCHED_FRAMES * (1000 / 60));
    expect(pacer.periodMs).toBeCloseTo(33.3, 0);
    expect(pacer.isSlow).toBe(false);
  });

  it("shares the time among the frames that were drawn in it", () => {
    const pacer = new FramePacer();
    for (let frame = 0; frame < 60; frame += 1) pacer.measured(0, 3 * 30, 3);
    expect(pacer.periodMs).toBeCloseTo(60, 0);
    expect(pacer.isSlow).toBe(false);
  });
});
