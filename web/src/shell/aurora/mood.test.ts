import { describe, expect, it } from "vitest";
import { LOOKS, approach, isSettled, moodOf } from "./mood";

describe("the mood of the background", () => {
  const live = { linkOpen: true, wasOpen: true, stopped: false, missionRuns: false };

  it("puts the link before the stop, and the stop before the mission", () => {
    expect(moodOf(live)).toBe("calm");
    expect(moodOf({ ...live, missionRuns: true })).toBe("mission");
    expect(moodOf({ ...live, missionRuns: true, stopped: true })).toBe("stopped");
    expect(moodOf({ ...live, stopped: true, linkOpen: false })).toBe("lost");
    expect(moodOf({ ...live, linkOpen: false, wasOpen: false })).toBe("calm");
  });

  it("changes gradually and arrives", () => {
    const first = approach(LOOKS.calm, LOOKS.stopped, 0.1);
    expect(first.stop).toBeGreaterThan(0);
    expect(first.stop).toBeLessThan(0.3);
    let look = LOOKS.calm;
    for (let step = 0; step < 200; step += 1) look = approach(look, LOOKS.stopped, 0.033);
    expect(look.stop).toBeCloseTo(1, 3);
    expect(isSettled(look, LOOKS.stopped)).toBe(true);
    expect(isSettled(first, LOOKS.stopped)).toBe(false);
    expect(approach(LOOKS.calm, LOOKS.lost, -1)).toEqual(LOOKS.calm);
  });
});
