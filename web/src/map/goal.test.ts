import { describe, expect, it } from "vitest";
import { besideGoalM, goalMessage, goalProgress, idsOf, initialPoseMessage, nudge, pathProblem, poseFromDrag, statusSince } from "./goal";

const ROBOT = { x: 0, y: 0, yaw: 1 };

describe("goals", () => {
  it("look along the drag, or from the robot after a click", () => {
    expect(poseFromDrag({ x: 1, y: 1 }, { x: 1, y: 3 }, true, ROBOT).yaw).toBeCloseTo(Math.PI / 2);
    expect(poseFromDrag({ x: 1, y: 1 }, { x: 1, y: 1 }, false, ROBOT).yaw).toBeCloseTo(Math.PI / 4);
    expect(poseFromDrag({ x: 0.1, y: 0 }, { x: 0.1, y: 0 }, false, ROBOT).yaw).toBe(1);
    expect(poseFromDrag({ x: 1, y: 1 }, { x: 1, y: 1 }, false, null).yaw).toBe(0);
  });

  it("move with the arrow keys along the screen, also on a turned map", () => {
    expect(nudge(ROBOT, 0.1, 0, 0, false)).toMatchObject({ x: 0.1, y: 0 });
    expect(nudge(ROBOT, 0.1, 0, 0, true).x).toBeCloseTo(-0.1);
    expect(nudge({ ...ROBOT, yaw: 3 }, 0, 0, 1, false).yaw).toBeCloseTo(4 - 2 * Math.PI);
  });

  it("become messages in the frame of the map", () => {
    const message = goalMessage({ x: 1, y: 2, yaw: Math.PI }, "map");
    expect(message.header.frame_id).toBe("map");
    expect(message.pose.orientation.z).toBeCloseTo(1);
    const initial = JSON.parse(JSON.stringify(initialPoseMessage(ROBOT, "map"))) as { pose: { covariance: number[] } };
    expect(initial.pose.covariance.length).toBe(36);
    expect(initial.pose.covariance[7]).toBe(0.25);
  });

  it("say why no path leads there", () => {
    expect(pathProblem(0)).toBeNull();
    expect(pathProblem(206)).toBe("map_goal_occupied");
    expect(pathProblem(999)).toBe("map_no_path");
  });

  it("are what navigation says of them, not of those before", () => {
    const goal = (id: number, sec: number, status: number) => ({ goal_info: { goal_id: { uuid: new Uint8Array(16).fill(id) }, stamp: { sec, nanosec: 0 } }, status });
    const before = [goal(1, 10, 4), goal(2, 11, 6)];
    const known = idsOf(before);
    expect(statusSince(before, known)).toBeNull();
    expect(statusSince([...before, goal(3, 12, 2)], known)).toBe(2);
    expect(statusSince([goal(4, 13, 5), goal(3, 12, 2), ...before], known)).toBe(5);
    expect(goalProgress(500, null)).toBe("sent");
    expect(goalProgress(5000, null)).toBe("unanswered");
    expect([1, 2, 3, 4, 5, 6].map((status) => goalProgress(60_000, status))).toEqual(["driving", "driving", "driving", "reached", "ended", "ended"]);
  });

  it("are said to be moved where the plan since then leads elsewhere", () => {
    const at = { x: 5, y: 0 };
    expect(besideGoalM(at, 900, { end: { x: 5, y: 0.41 }, ageMs: 500 })).toBeCloseTo(0.41);
    expect(besideGoalM(at, 900, { end: { x: 5, y: 0.1 }, ageMs: 500 })).toBeNull();
    expect(besideGoalM(at, 100, { end: { x: 1, y: 0 }, ageMs: 500 })).toBeNull(); // a plan from before
    expect(besideGoalM(at, 900, { end: null, ageMs: Infinity })).toBeNull();
  });
});
