import { describe, expect, it } from "vitest";
import { PoseHistory } from "./pose_history";

describe("the history of poses", () => {
  it("finds the pose between two", () => {
    const history = new PoseHistory();
    history.add(10, { x: 0, y: 0, yaw: 3 });
    history.add(11, { x: 2, y: 0, yaw: -3 });
    expect(history.at(10.5)).toMatchObject({ x: 1, y: 0 });
    expect(Math.abs(history.at(10.5)!.yaw)).toBeCloseTo(Math.PI);
    expect(history.at(11)?.yaw).toBe(-3);
  });

  it("covers neither the past nor the future", () => {
    const history = new PoseHistory();
    expect(history.at(1)).toBeNull();
    history.add(10, { x: 0, y: 0, yaw: 0 });
    expect(history.at(9)).toBeNull();
    expect(history.at(11)).toBeNull();
    for (let stampS = 11; stampS < 30; stampS += 1) history.add(stampS, { x: stampS, y: 0, yaw: 0 });
    expect(history.at(12.5)).toBeNull();
    expect(history.at(28.5)?.x).toBe(28.5);
  });

  it("passes over late poses, but follows a clock that was set back", () => {
    const history = new PoseHistory();
    history.add(10, { x: 0, y: 0, yaw: 0 });
    history.add(9.9, { x: 5, y: 0, yaw: 0 });
    expect(history.newestS).toBe(10);
    history.add(2, { x: 7, y: 0, yaw: 0 });
    expect(history.newestS).toBe(2);
  });
});
