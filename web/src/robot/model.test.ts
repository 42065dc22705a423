import { describe, expect, it } from "vitest";
import { GRIPPER } from "@/generated/robot";
import { BODIES, bodyPoses, fingerOffset } from "./model";

describe("the robot's model", () => {
  it("opens and closes its gripper by half the aperture on each side", () => {
    expect(fingerOffset(GRIPPER.openRad)).toBeCloseTo(GRIPPER.openApertureM / 2);
    expect(fingerOffset(GRIPPER.closedRad)).toBeCloseTo(GRIPPER.closedApertureM / 2);
    expect(fingerOffset(99)).toBeCloseTo(GRIPPER.closedApertureM / 2);
  });

  it("names each parent before its children", () => {
    const names = BODIES.map(({ name }) => name);
    for (const [index, { parent }] of BODIES.entries()) expect(["", ...names.slice(0, index)]).toContain(parent);
  });

  it("turns each joint about its own axis, and keeps unknown ones at 0", () => {
    const poses = bodyPoses(new Map([["shoulder_pan_joint", Math.PI / 2], ["gripper_joint", GRIPPER.openRad]]));
    expect(poses.get("shoulder_pan")?.rotation.z).toBeCloseTo(Math.SQRT1_2);
    expect(poses.get("wrist")?.rotation).toEqual(poses.get("shoulder_pan")?.rotation);
    const [left, right] = [poses.get("finger_left")!.translation, poses.get("finger_right")!.translation];
    expect(right.x - left.x).toBeCloseTo(GRIPPER.openApertureM);
    expect(right.y).toBeCloseTo(left.y);
  });
});
