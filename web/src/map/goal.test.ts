import { describe, expect, it } from "vitest";
import { goalMessage, goalProgress, initialPoseMessage, nudge, pathProblem, poseFromDrag } from "./goal";

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

  it("are confirmed by the robot's plan, not by having been sent", () => {
    const goal = { x: 5, y: 0, yaw: 0 };
    expect(goalProgress(goal, 100, { end: null, ageMs: Infinity }, ROBOT)).toBe("sent");
    // A plan from before the goal was sent confirms nothing.
    expect(goalProgress(goal, 100, { end: { x: 5, y: 0 }, ageMs: 500 }, ROBOT)).toBe("sent");
    expect(goalProgress(goal, 900, { end: { x: 5, y: 0 }, ageMs: 500 }, ROBOT)).toBe("driving");
    expect(goalProgress(goal, 5000, { end: { x: 1, y: 1 }, ageMs: 500 }, ROBOT)).toBe("unanswered");
    expect(goalProgress(goal, 9000, { end: { x: 5, y: 0 }, ageMs: 2000 }, { x: 4.9, y: 0, yaw: 0 })).toBe("reached");
  });
});
