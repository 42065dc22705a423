import { describe, expect, it } from "vitest";
import type { nav_msgs_Path } from "@/generated/messages";
import { PLAN_FORGOTTEN_MS, PLAN_STALE_MS, Trail, lengthOf, readPath, remaining, shownPlan } from "./route";

const POINTS = [0, 1, 2, 3].map((x) => ({ x, y: 0 }));

describe("the plan", () => {
  it("is read without what is not finite, and from answers whose NaN became null", () => {
    const pose = (x: number | null) => ({ pose: { position: { x, y: 0, z: 0 } } });
    expect(readPath({ poses: [pose(1), pose(NaN), pose(null), null] } as unknown as nav_msgs_Path)).toEqual([{ x: 1, y: 0 }]);
    expect(readPath(null)).toEqual([]);
    expect(readPath({} as nav_msgs_Path)).toEqual([]);
  });

  it("goes on from the robot", () => {
    const left = remaining(POINTS, { x: 1.2, y: 0.1 });
    expect(left).toEqual([{ x: 1.2, y: 0.1 }, { x: 2, y: 0 }, { x: 3, y: 0 }]);
    expect(lengthOf(left)).toBeCloseTo(Math.hypot(0.8, 0.1) + 1);
    expect(remaining(POINTS, null)).toEqual(POINTS);
    expect(lengthOf(remaining([], { x: 0, y: 0 }))).toBe(0);
  });
});

describe("the plan on the map", () => {
  const plan = { points: POINTS, receivedMs: 1000 };
  const pose = { x: 1, y: 0 };

  it("is followed while it is new, shown while it is old, and then forgotten", () => {
    expect(shownPlan(plan, pose, 1000 + PLAN_STALE_MS)?.isFollowed).toBe(true);
    expect(shownPlan(plan, pose, 1001 + PLAN_STALE_MS)?.isFollowed).toBe(false);
    expect(shownPlan(plan, pose, 1001 + PLAN_FORGOTTEN_MS)).toBeNull();
  });

  it("is gone once it was driven", () => {
    expect(shownPlan(plan, { x: 2.95, y: 0 }, 1000)).toBeNull();
    expect(shownPlan({ points: [], receivedMs: 0 }, pose, 0)).toBeNull();
    expect(shownPlan(null, pose, 0)).toBeNull();
  });
});

describe("the trail", () => {
  it("grows by steps, and begins anew after a jump", () => {
    const trail = new Trail();
    expect(trail.add({ x: 0, y: 0, yaw: 0 }, 0)).toBe(true);
    expect(trail.add({ x: 0.01, y: 0, yaw: 1 }, 1)).toBe(false);
    expect(trail.add({ x: 0.1, y: 0, yaw: 0 }, 2)).toBe(true);
    expect(trail.add({ x: 3, y: 0, yaw: 0 }, 3)).toBe(true);
    expect(trail.points.map((point) => point.begins)).toEqual([true, false, true]);
  });

  it("forgets its beginning in the end", () => {
    const trail = new Trail();
    for (let step = 0; step < 6000; step += 1) trail.add({ x: step * 0.1, y: 0, yaw: 0 }, step);
    expect(trail.points.length).toBe(5000);
    expect(trail.points[0]?.atMs).toBe(1000);
  });
});
