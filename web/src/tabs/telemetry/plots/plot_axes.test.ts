import { describe, expect, it } from "vitest";
import { axisNumber, rangeOf, timeLabel, timeSplits } from "./plot_axes";

describe("the axes of a plot", () => {
  it("have fewer marks where there is less room", () => {
    expect(timeSplits(0, 60, 200)).toEqual([0, 30, 60]);
    expect(timeSplits(0, 60, 0)).toEqual([0, 60]);
  });

  it("do not blow up noise", () => {
    const [low, high] = rangeOf(12.3, 12.301);
    expect(high - low).toBeCloseTo(0.246, 2);
  });

  it("leave air around the values, also around one that stands still", () => {
    expect(rangeOf(0, 10)).toEqual([-0.8, 10.8]);
    const [low, high] = rangeOf(12, 12);
    expect(high).toBeGreaterThan(12);
    expect(low).toBeLessThan(12);
    expect(rangeOf(0, 0)).toEqual([-0.05, 0.05]);
  });

  it("survive without values", () => {
    expect(rangeOf(null, null)).toEqual([-1, 1]);
    expect(rangeOf(NaN, NaN)).toEqual([-1, 1]);
  });

  it("are written with a real minus", () => {
    expect([0, -5, -60, -120].map(timeLabel)).toEqual(["0 s", "−5 s", "−1 min", "−2 min"]);
    expect([0, -0.5, 123456, 0.00012].map(axisNumber)).toEqual(["0", "−0.5", "1.2e+5", "1.2e−4"]);
  });

  it("count back from the newest time", () => {
    expect(timeSplits(40, 100, 500)).toEqual([40, 50, 60, 70, 80, 90, 100]);
    expect(timeSplits(0, 300, 500)).toEqual([0, 60, 120, 180, 240, 300]);
  });
});
