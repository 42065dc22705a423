// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { approachPose, overridesFile } from "./approaches";

describe("the file of overrides", () => {
  it("has quoted ids in their order, and the values of each", () => {
    const approach = { goal_x: 1, goal_y: -2.5, yaw: 0.75 };
    expect(overridesFile({ "10": approach, "2": { ...approach, standoff: 0.6 }, 'a"b': { standoff: 0.5 } })).toBe(
      'overrides:\n  "2": {goal_x: 1.0000, goal_y: -2.5000, yaw: 0.7500, standoff: 0.6000}\n' +
        '  "10": {goal_x: 1.0000, goal_y: -2.5000, yaw: 0.7500}\n' +
        '  "a\\"b": {standoff: 0.5000}\n',
    );
  });
});

it("an approach has a pose where nothing of it is left to be computed", () => {
  expect(approachPose({ goal_x: 1, goal_y: 0, yaw: 0 })).toEqual({ x: 1, y: 0, yaw: 0 });
  expect(approachPose({ goal_x: 1, yaw: 0 })).toBeNull();
  expect(approachPose(undefined)).toBeNull();
});
