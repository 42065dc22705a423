import { describe, expect, it } from "vitest";
import type { trajectory_msgs_JointTrajectory } from "@/generated/messages";
import { jointCommand, jointPhase, moveCommands, trajectoryCommands } from "./commands";
import { ARM } from "./joints";

const elbow = ARM[2]!;
const gripper = ARM[4]!;

describe("a commanded joint", () => {
  const command = jointCommand(elbow, 60, 0, 60, 0);

  it("moves until it is within 3 degrees", () => {
    expect(jointPhase(elbow, command, 10, 500)).toBe("moving");
    expect(jointPhase(elbow, command, 56.9, 500)).toBe("moving");
    expect(jointPhase(elbow, command, 57, 500)).toBe("settled");
  });

  it("has stalled after displacement by rate, and slack", () => {
    expect(command.dueMs).toBe(2000);
    expect(jointPhase(elbow, command, 50, 1999)).toBe("moving");
    expect(jointPhase(elbow, command, 50, 2000)).toBe("stalled");
    expect(jointPhase(elbow, command, 60, 9000)).toBe("settled");
  });

  it("is given 2.5 s and 4 degrees as a gripper", () => {
    const grasp = jointCommand(gripper, 30, -30, 60, 0);
    expect(grasp.dueMs).toBe(2500);
    expect(jointPhase(gripper, grasp, 26, 100)).toBe("settled");
    expect(jointPhase(gripper, grasp, 25.9, 2500)).toBe("stalled");
  });

  it("is neither without feedback or a command", () => {
    expect(jointPhase(elbow, command, undefined, 500)).toBe("unknown");
    expect(jointPhase(elbow, undefined, 10, 500)).toBe("idle");
  });
});

describe("commands from a trajectory", () => {
  const message = (points: unknown[]): trajectory_msgs_JointTrajectory =>
    ({ joint_names: ["wrist_joint", "elbow_joint", "unheard_of"], points }) as unknown as trajectory_msgs_JointTrajectory;

  it("are its last point, in its time", () => {
    const points = [
      { positions: [9, 9, 9], time_from_start: { sec: 0, nanosec: 0 } },
      { positions: [0, Math.PI / 2, 9], time_from_start: { sec: 3, nanosec: 500_000_000 } },
    ];
    expect(trajectoryCommands(message(points), 1000)).toEqual({
      wrist_joint: { targetDeg: 0, dueMs: 5500 },
      elbow_joint: { targetDeg: 90, dueMs: 5500 },
    });
  });

  it("are none where it is empty or damaged", () => {
    expect(trajectoryCommands(message([]), 0)).toEqual({});
    expect(trajectoryCommands(message([{ positions: [NaN], time_from_start: { sec: 1, nanosec: 0 } }]), 0)).toEqual({});
    expect(moveCommands({}, 3, 0)).toEqual({});
  });
});
