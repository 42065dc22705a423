import { describe, expect, it } from "vitest";
import { SERVICES } from "@/generated/graph";
import { nextTorque, torqueObstacles } from "./torque";

describe("the torque", () => {
  it("arms the sliders only once the robot confirmed the switch", () => {
    expect(nextTorque(null, { kind: "reported", on: true })).toBeNull();
    expect(nextTorque(null, { kind: "confirmed", on: true })).toBe(true);
    expect(nextTorque(true, { kind: "reported", on: true })).toBe(true);
  });

  it("is off when the robot says so, and unknown when it returned without us", () => {
    expect(nextTorque(true, { kind: "reported", on: false })).toBe(false);
    expect(nextTorque(false, { kind: "reported", on: true })).toBeNull();
    expect(nextTorque(true, { kind: "confirmed", on: false })).toBe(false);
  });

  it("is unknown after a lost link and a failed switch", () => {
    expect(nextTorque(true, { kind: "link-lost" })).toBeNull();
    expect(nextTorque(true, { kind: "failed" })).toBeNull();
  });
});

describe("the switch of the torque", () => {
  const keys = (of: readonly { key: string }[]) => of.map(({ key }) => key);
  const ALL = (["why_no_link", "why_other_tab", "why_viewer", "why_estop", "why_control", "why_gate", "why_hold_first", "why_mission", "arm_why_calibrating", "arm_why_torque_off"] as const).map((key) => ({ key }));

  it("enables a stopped arm, and does not let it sink", () => {
    const stopped = [{ key: "why_estop" as const }, { key: "why_gate" as const }];
    expect(torqueObstacles(stopped, true)).toEqual([]);
    expect(keys(torqueObstacles(stopped, false))).toEqual(["why_estop"]);
  });

  it("needs what every command needs, and no gate: it moves nothing", () => {
    expect(keys(torqueObstacles(ALL, true))).toEqual(["why_no_link", "why_other_tab", "why_viewer", "why_control", "arm_why_calibrating"]);
    expect(SERVICES.ARM_SET_TORQUE.moves).toBe(false);
  });
});
