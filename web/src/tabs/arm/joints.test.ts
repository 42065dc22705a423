import { describe, expect, it } from "vitest";
import { ARM, clampToLimits, gripperDegrees, gripperRadians, measuredAngles } from "./joints";

const gripper = ARM[4]!;
const lift = ARM[1]!;

describe("the arm's joints", () => {
  it("are moved by the services of the arm bridge", () => {
    expect(ARM.map(({ service }) => service.name)).toEqual([
      "/lupin/arm/shoulder_pan/set_angle_with_speed",
      "/lupin/arm/shoulder_lift/set_angle_with_speed",
      "/lupin/arm/elbow/set_angle_with_speed",
      "/lupin/arm/wrist/set_angle_with_speed",
      "/lupin/gripper/set_angle_with_speed",
    ]);
  });

  it("stay within their limits", () => {
    expect(clampToLimits(lift, -90)).toBe(-86);
    expect(clampToLimits(lift, 90)).toBe(85);
    expect(clampToLimits(gripper, 99)).toBe(30);
  });

  it("are measured in degrees, the gripper on its inverted scale", () => {
    const message = { name: ["gripper_joint", "elbow_joint", "x"], position: new Float64Array([-0.2, Math.PI / 2, 9]) };
    expect(measuredAngles(message)).toEqual({ gripper_joint: -30, elbow_joint: 90 });
    expect(gripperDegrees(0.25)).toBe(30);
    expect(gripperDegrees(7)).toBe(30);
    expect(gripperRadians(-30)).toBe(-0.2);
    expect(gripperRadians(30)).toBe(0.25);
  });

  it("are unknown in an empty message and where they are not a number", () => {
    expect(measuredAngles({ name: [], position: new Float64Array() })).toEqual({});
    expect(measuredAngles({ name: ["elbow_joint"], position: new Float64Array([NaN]) })).toEqual({});
    expect(measuredAngles({ name: ["elbow_joint"], position: new Float64Array() })).toEqual({});
  });
});
