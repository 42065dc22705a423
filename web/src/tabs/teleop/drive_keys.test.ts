import { describe, expect, it } from "vitest";
import { velocityOfGamepad, velocityOfKeys } from "./drive_keys";

describe("driving keys", () => {
  it("add up, and a diagonal is no faster", () => {
    const { x, y } = velocityOfKeys(["KeyW", "KeyA"]);
    expect(Math.hypot(x, y)).toBeCloseTo(1);
    expect(velocityOfKeys(["KeyW", "KeyS"])).toEqual({ x: 0, y: 0, yaw: 0 });
    expect(velocityOfKeys(["KeyQ"])).toEqual({ x: 0, y: 0, yaw: 1 });
    expect(velocityOfKeys(["KeyX"])).toEqual({ x: 0, y: 0, yaw: 0 });
  });
});

describe("the gamepad", () => {
  it("drives only while its dead-man button is held", () => {
    expect(velocityOfGamepad([0, -1, 0], false)).toEqual({ x: 0, y: 0, yaw: 0 });
    expect(velocityOfGamepad([0, -1, 0.5], true)).toEqual({ x: 1, y: 0, yaw: -0.5 });
  });

  it("rests within its dead zone", () => {
    expect(velocityOfGamepad([0.1, -0.1, 0.1], true)).toEqual({ x: 0, y: 0, yaw: 0 });
  });
});
