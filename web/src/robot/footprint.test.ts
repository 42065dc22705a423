import { describe, expect, it } from "vitest";
import { BASE, CHASSIS, WHEELS, cornersAt, halfExtents } from "./footprint";

describe("the robot's outline", () => {
  it("turns shapes into their body's axes", () => {
    const cylinder = {
      kind: "cylinder" as const,
      name: "",
      size: { x: 0.05, y: 0.02, z: 0 },
      pose: { translation: { x: 0, y: 0, z: 0 }, rotation: { x: Math.SQRT1_2, y: 0, z: 0, w: Math.SQRT1_2 } },
      color: [],
    };
    const { x, y, z } = halfExtents(cylinder);
    expect(x).toBeCloseTo(0.05);
    expect(y).toBeCloseTo(0.02);
    expect(z).toBeCloseTo(0.05);
  });

  it("includes four wheels beside the chassis", () => {
    expect(WHEELS.length).toBe(4);
    expect(BASE.maxY).toBeGreaterThan(CHASSIS.maxY);
    expect(BASE.maxX - BASE.minX).toBeGreaterThanOrEqual(CHASSIS.maxX - CHASSIS.minX);
  });

  it("follows the robot", () => {
    const [frontLeft] = cornersAt({ minX: -1, maxX: 2, minY: -1, maxY: 1 }, { x: 10, y: 0, yaw: Math.PI / 2 });
    expect(frontLeft.x).toBeCloseTo(9);
    expect(frontLeft.y).toBeCloseTo(2);
  });
});
