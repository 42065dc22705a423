import { describe, expect, it } from "vitest";
import { FIGURE_PERIOD_S, figureEight } from "./figure_eight";
import { LOOP_S, TAGS_PER_MISSION, figureAtTagS, legBeginS, loopState } from "./mission_loop";

describe("the mission loop", () => {
  it("takes 50 s over four tags", () => {
    expect(LOOP_S).toBe(50);
    const phases = [0, 4, 7, 12, 15, 16, 42, 43, 47, 49.9].map((timeS) => {
      const { phase, tag } = loopState(timeS);
      return `${phase} ${tag}`;
    });
    expect(phases).toEqual([
      "ready 0",
      "localizing 0",
      "navigating 0",
      "scanning 0",
      "publishing 0",
      "navigating 1",
      "publishing 3",
      "returning 4",
      "done 4",
      "done 4",
    ]);
    expect(loopState(50)).toMatchObject({ loop: 1, phase: "ready" });
  });

  it("moves the robot without a jump, and only while it drives", () => {
    let before = loopState(0);
    for (let timeS = 0; timeS < 2 * LOOP_S; timeS += 0.05) {
      const now = loopState(timeS);
      expect(now.figureS - before.figureS).toBeLessThan(0.06);
      if (now.phase === before.phase && !["navigating", "returning"].includes(now.phase)) expect(now.figureS).toBeCloseTo(before.figureS, 9);
      before = now;
    }
    expect(loopState(2 * LOOP_S).figureS).toBeCloseTo(FIGURE_PERIOD_S, 6);
    expect(figureEight(FIGURE_PERIOD_S).x).toBeCloseTo(0, 6);
  });

  it("begins a tag's leg where the last one ended", () => {
    for (let tag = 0; tag < TAGS_PER_MISSION; tag += 1) {
      const begin = loopState(legBeginS(3, tag));
      expect(begin).toMatchObject({ loop: 3, phase: "navigating", tag });
      expect(loopState(legBeginS(3, tag) + 6).figureS).toBeCloseTo(figureAtTagS(3, tag), 6);
    }
    expect(loopState(legBeginS(3, TAGS_PER_MISSION)).phase).toBe("returning");
  });
});
