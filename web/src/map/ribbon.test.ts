import { describe, expect, it } from "vitest";
import { ribbon } from "./ribbon";

describe("a ribbon", () => {
  it("is a band along its path, seen from above", () => {
    const { positions, indices } = ribbon([{ x: 0, y: 0 }, { x: 1, y: 0 }, { x: 1, y: 0 }, { x: 2, y: 0 }], 0.2, 0.01);
    expect(positions.length).toBe(18);
    expect([...positions.subarray(0, 6)].map((value) => Math.round(value * 100) / 100)).toEqual([0, 0.1, 0.01, 0, -0.1, 0.01]);
    const [a, b, c] = [0, 1, 2].map((offset) => indices[offset]! * 3);
    const cross =
      (positions[b!]! - positions[a!]!) * (positions[c! + 1]! - positions[a! + 1]!) -
      (positions[b! + 1]! - positions[a! + 1]!) * (positions[c!]! - positions[a!]!);
    expect(cross).toBeGreaterThan(0);
  });

  it("is empty without two points", () => {
    expect(ribbon([], 1, 0).indices.length).toBe(0);
    expect(ribbon([{ x: 1, y: 1 }, { x: 1, y: 1 }], 1, 0).positions.length).toBe(0);
  });
});
