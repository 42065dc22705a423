import { Group } from "three";
import { describe, expect, it } from "vitest";
import { BODIES, GRIPPER_APERTURE_M } from "@/generated/robot_model";
import { GRIPPER } from "@/generated/robot";
import { fingerOffset, poseJoints } from "./robot_model";

describe("the robot's model", () => {
  it("opens and closes its gripper by half the aperture on each side", () => {
    expect(fingerOffset(GRIPPER.openRad)).toBeCloseTo(GRIPPER_APERTURE_M[0] / 2);
    expect(fingerOffset(GRIPPER.closedRad)).toBeCloseTo(GRIPPER_APERTURE_M[1] / 2);
    expect(fingerOffset(99)).toBeCloseTo(GRIPPER_APERTURE_M[1] / 2);
  });

  it("turns each joint about its own axis, and leaves unknown ones alone", () => {
    const groups = new Map(BODIES.filter((body) => body.joint !== "").map((body) => [body.name, new Group()]));
    poseJoints(groups, new Map([["shoulder_pan_joint", Math.PI / 2], ["gripper_joint", GRIPPER.openRad]]));
    expect(groups.get("shoulder_pan")?.quaternion.z).toBeCloseTo(Math.SQRT1_2);
    expect(groups.get("elbow")?.quaternion.w).toBe(1);
    const [left, right] = [groups.get("finger_left"), groups.get("finger_right")];
    expect(left!.position.y).toBeGreaterThan(0);
    expect(right!.position.y).toBeCloseTo(-left!.position.y);
  });
});
