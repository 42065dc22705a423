import { describe, expect, it } from "vitest";
import { FrameWatch } from "./frame_watch";

/** Whether a watch calls frames of these lengths slow, and after how long, ms. */
function judge(periodsMs: number[], watch = new FrameWatch()): number | null {
  let nowMs = 5000;
  watch.isSlow(nowMs);
  for (const period of periodsMs) {
    nowMs += period;
    if (watch.isSlow(nowMs)) return nowMs - 5000;
  }
  return null;
}

const each = (periodMs: number, count = 200) => Array<number>(count).fill(periodMs);

describe("the watch of frames", () => {
  it.each([
    [208, 1040],
    [60, 1020],
    [45, 900],
    [33, null],
    [16.7, null],
  ])("judges frames of %d ms after %d ms", (periodMs, expected) => {
    expect(judge(each(periodMs))).toBe(expected);
  });

  it("is not decided by a stall", () => {
    expect(judge([...each(16, 7), 2500, ...each(16, 30), 900, ...each(16)])).toBeNull();
  });

  it("forgets what was before a time without frames", () => {
    const watch = new FrameWatch();
    expect(judge(each(45, 15), watch)).toBeNull();
    watch.reset();
    expect(judge(each(16), watch)).toBeNull();
  });
});
