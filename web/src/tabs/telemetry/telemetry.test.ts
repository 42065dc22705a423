import { describe, expect, it } from "vitest";
import { chargeOf, chargeShare } from "@/state/battery";
import { numericFields, valueAt } from "./fields";
import { orientation } from "./orientation";
import { processRows, rateRows } from "./run_rows";

describe("the battery", () => {
  it("is read as a share or in percent", () => {
    expect([0.86, 86, 1, 140].map(chargeShare)).toEqual([0.86, 0.86, 1, 1]);
    expect([NaN, null, undefined, -1].map(chargeShare)).toEqual([null, null, null, null]);
  });

  it("is good, soon low, and low where the robot returns", () => {
    expect([0.9, 0.34, 0.19, null].map(chargeOf)).toEqual(["good", "soon", "low", "unknown"]);
  });
});

describe("the orientation", () => {
  it("is roll, pitch and yaw", () => {
    const half = Math.SQRT1_2;
    expect(orientation({ x: 0, y: 0, z: half, w: half })?.yawDeg).toBeCloseTo(90);
    expect(orientation({ x: half, y: 0, z: 0, w: half })?.rollDeg).toBeCloseTo(90);
    expect(orientation({ x: 0, y: half, z: 0, w: half })?.pitchDeg).toBeCloseTo(90);
  });

  it("is unknown for what is no rotation", () => {
    expect(orientation({ x: 0, y: 0, z: 0, w: 0 })).toBeNull();
    expect(orientation({ x: NaN, y: 0, z: 0, w: 1 })).toBeNull();
  });
});

describe("the fields of a message", () => {
  const message = { header: { frame_id: "odom" }, twist: { x: 1.5, ok: true }, ranges: new Float32Array([1, 2]), names: ["a"], big: 7n };

  it("are found with their paths", () => {
    expect(numericFields(message)).toEqual([
      { path: "twist.x", value: 1.5 },
      { path: "twist.ok", value: 1 },
      { path: "ranges[0]", value: 1 },
      { path: "ranges[1]", value: 2 },
      { path: "big", value: 7 },
    ]);
  });

  it("are read by their paths", () => {
    expect(valueAt(message, "ranges[1]")).toBe(2);
    expect(valueAt(message, "twist.ok")).toBe(1);
    for (const path of ["ranges[9]", "twist", "header.frame_id", "x.y.z", ""]) expect(valueAt(message, path)).toBeNaN();
  });

  it("are called by the names that stand beside them", () => {
    const joints = { name: ["wheel", "elbow_joint"], position: new Float64Array([3, 0.5]), velocity: new Float64Array() };
    expect(numericFields(joints)).toEqual([
      { path: "position[wheel]", value: 3 },
      { path: "position[elbow_joint]", value: 0.5 },
    ]);
    expect(valueAt(joints, "position[elbow_joint]")).toBe(0.5);
    expect(valueAt(joints, "velocity[elbow_joint]")).toBeNaN();
    expect(valueAt(joints, "position[nobody]")).toBeNaN();
    expect(numericFields({ name: ["a", "a"], position: [1, 2] }).map(({ path }) => path)).toEqual(["position[0]", "position[1]"]);
  });

  it("are bounded in number and in depth", () => {
    expect(numericFields({ ranges: new Float32Array(5000) })).toHaveLength(32);
    expect(numericFields(Array.from({ length: 30 }, () => new Float64Array(30)), 50)).toHaveLength(50);
    const circle: Record<string, unknown> = { x: 1 };
    circle["self"] = circle;
    expect(numericFields(circle, 50).length).toBeLessThanOrEqual(50);
    expect(numericFields(null)).toEqual([]);
  });
});

describe("the run", () => {
  const stage = (name: string, phase: string, trouble = "") => ({ name, phase, trouble, why: "", waiting_for: phase === "waiting" ? ["no /map", "no /scan"] : [] });

  it("lists what needs a person first", () => {
    const rows = processRows({ stages: [stage("a", "up"), stage("b", "waiting"), stage("c", "up", "is silent"), stage("d", "failed")] });
    expect(rows.map(({ name, health }) => `${name} ${health}`)).toEqual(["d failed", "c trouble", "b waiting", "a up"]);
    expect(rows[2]?.remark).toBe("no /map; no /scan");
    expect(processRows({})).toEqual([]);
  });

  it("finds silent and slow topics", () => {
    const rows = rateRows({ rates_hz: { "/scan": 9.8, "/joint_states": 12, "/unheard_of": 3 }, silent_s: { "/map": 9 } });
    expect(rows.map(({ topic, isSlow, silentS }) => [topic, isSlow, silentS])).toEqual([
      ["/map", false, 9],
      ["/joint_states", true, null],
      ["/scan", false, null],
      ["/unheard_of", false, null],
    ]);
    expect(rateRows({})).toEqual([]);
  });
});
