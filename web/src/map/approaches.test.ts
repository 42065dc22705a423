import { describe, expect, it } from "vitest";
import { overridesFile } from "./approaches";

describe("the file of overrides", () => {
  it("has quoted ids in their order, and a pose for each", () => {
    const pose = { x: 1, y: -2.5, yaw: 0.75 };
    expect(overridesFile({ "10": pose, "2": pose, 'a"b': pose })).toBe(
      'overrides:\n  "2": {goal_x: 1.000, goal_y: -2.500, yaw: 0.7500}\n' +
        '  "10": {goal_x: 1.000, goal_y: -2.500, yaw: 0.7500}\n' +
        '  "a\\"b": {goal_x: 1.000, goal_y: -2.500, yaw: 0.7500}\n',
    );
  });
});
