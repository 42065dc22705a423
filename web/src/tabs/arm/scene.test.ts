import { describe, expect, it } from "vitest";
import { armPoses, skeleton } from "./kinematics";
import { VIEWS, projection, visibleFaces } from "./scene";

const tipOf = (angles: Parameters<typeof skeleton>[0]) => skeleton(angles).fingers[0]![1];

describe("the arm's kinematics", () => {
  it("stands upright at zero", () => {
    const { chain } = skeleton({});
    for (const { x, y } of chain.slice(1)) {
      expect(x).toBeCloseTo(0.0855, 3);
      expect(y).toBeCloseTo(0, 6);
    }
    expect(chain.map(({ z }) => z)).toEqual(chain.map(({ z }) => z).toSorted((a, b) => a - b));
  });

  it("leans backwards for a positive lift and turns left for a positive pan", () => {
    expect(tipOf({ shoulder_lift_joint: 60 }).x).toBeLessThan(0);
    expect(tipOf({ shoulder_lift_joint: -60 }).x).toBeGreaterThan(0.2);
    expect(tipOf({ shoulder_pan_joint: 90, shoulder_lift_joint: -60 }).y).toBeGreaterThan(0.2);
  });

  it("opens the fingers at -30 degrees", () => {
    const gap = (degrees: number) => {
      const poses = armPoses({ gripper_joint: degrees });
      return poses.get("finger_left")!.translation.y - poses.get("finger_right")!.translation.y;
    };
    expect(gap(-30)).toBeCloseTo(0.0656, 4);
    expect(gap(30)).toBeCloseTo(0.0008, 4);
  });
});

describe("the picture of the arm", () => {
  it("has the front at the right from the side, and from above", () => {
    for (const view of [VIEWS.side, VIEWS.top]) expect(projection(view)({ x: 1, y: 0, z: 0 }).x).toBeCloseTo(1);
    expect(projection(VIEWS.side)({ x: 0, y: 0, z: 1 }).y).toBeCloseTo(1);
    expect(projection(VIEWS.side)({ x: 0, y: -1, z: 0 }).depth).toBeCloseTo(1);
    expect(projection(VIEWS.top)({ x: 0, y: 1, z: 0 }).y).toBeCloseTo(1);
    expect(projection(VIEWS.top)({ x: 0, y: 0, z: 1 }).depth).toBeCloseTo(1);
  });

  it("is painted from far to near, without faces that are turned away", () => {
    const faces = visibleFaces({}, VIEWS.free);
    expect(faces.length).toBeGreaterThan(50);
    expect(faces.map(({ depth }) => depth)).toEqual(faces.map(({ depth }) => depth).toSorted((a, b) => a - b));
    for (const { light } of faces) expect(light).toBeGreaterThanOrEqual(0);
  });
});
