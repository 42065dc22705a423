import { describe, expect, it } from "vitest";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { ENDS, type MissionAction, type MissionFacts, readTagIds, refusal } from "./mission_rules";

function facts(mission: Partial<lupin_msgs_MissionState> | null, changes: Partial<MissionFacts> = {}): MissionFacts {
  const state = { lifecycle_state: "READY", current_target: "", paused: false, estop_engaged: false, battery_low: false, ...mission };
  return {
    linkOpen: true,
    isRewound: false,
    isViewer: false,
    isHeldByOther: false,
    isWatching: false,
    stopped: false,
    isGateClosed: false,
    mission: mission === null ? null : (state as lupin_msgs_MissionState),
    ...changes,
  };
}

const ACTIONS: MissionAction[] = ["start", "pause", "resume", "abort", "skip", "dock", "reset"];
const possible = (given: MissionFacts) => ACTIONS.filter((action) => refusal(action, given) === null);

describe("mission controls", () => {
  it.each([
    ["BOOT", []],
    ["READY", ["start"]],
    ["DONE", ["start"]],
    ["FAULT", ["reset"]],
    ["PREPARE", ["pause", "abort"]],
    ["EXPLORING", ["pause", "abort", "dock"]],
    ["MONITORING", ["pause", "abort", "dock"]],
    ["INSPECTING", ["pause", "abort", "skip", "dock"]],
    ["RETURNING", ["pause", "abort"]],
    ["UNHEARD_OF", []],
  ])("allow in %s what the robot accepts", (lifecycle_state, expected) => {
    expect(possible(facts({ lifecycle_state, current_target: "4" }))).toEqual(expected);
  });

  it("allow to resume what is paused, after the e-stop was released", () => {
    const paused = { lifecycle_state: "MONITORING", paused: true };
    expect(possible(facts(paused))).toEqual(["resume", "abort", "dock"]);
    expect(refusal("resume", facts(paused, { stopped: true }))).toBe("mission_release_first");
    expect(refusal("resume", facts({ ...paused, battery_low: true }))).toBe("mission_charge_first");
  });

  it("start nothing while the robot is stopped or its battery low", () => {
    expect(refusal("start", facts({}, { stopped: true }))).toBe("mission_release_first");
    expect(refusal("start", facts({ estop_engaged: true }))).toBe("mission_release_first");
    expect(refusal("start", facts({ battery_low: true }))).toBe("mission_charge_first");
  });

  it("start nothing while it is not known whether the robot is stopped", () => {
    const unknown = { stopped: null };
    expect(refusal("start", facts({}, unknown))).toBe("mission_stop_unknown");
    expect(possible(facts({ lifecycle_state: "MONITORING", paused: true }, unknown))).toEqual(["abort"]);
    expect(possible(facts({ lifecycle_state: "EXPLORING" }, unknown))).toEqual(["pause", "abort"]);
  });

  it("set nothing in motion through a closed gate, and let what moves be paused", () => {
    expect(refusal("start", facts({}, { isGateClosed: true }))).toBe("mission_hold_first");
    const paused = facts({ lifecycle_state: "MONITORING", paused: true }, { isGateClosed: true });
    expect(refusal("resume", paused)).toBe("mission_hold_first");
    expect(refusal("dock", paused)).toBe("mission_hold_first");
    expect(possible(facts({ lifecycle_state: "INSPECTING", current_target: "4" }, { isGateClosed: true }))).toEqual(["pause"]);
    expect(possible(facts({ lifecycle_state: "FAULT" }, { isGateClosed: true }))).toEqual(["reset"]);
  });

  it("do not drive to the dock while the robot is stopped", () => {
    for (const lifecycle_state of ["EXPLORING", "INSPECTING", "MONITORING"]) {
      expect(refusal("dock", facts({ lifecycle_state }, { stopped: true }))).toBe("mission_release_first");
      expect(refusal("dock", facts({ lifecycle_state, estop_engaged: true, paused: true }))).toBe("mission_release_first");
    }
  });

  it("name what each of them ends", () => {
    expect(ACTIONS.filter((action) => ENDS[action] !== null)).toEqual(["abort", "skip", "dock"]);
  });

  it("do not strand a robot that drives to its charger", () => {
    const returning = { lifecycle_state: "RETURNING", battery_low: true };
    expect(possible(facts(returning))).toEqual([]);
  });

  it("need a link, a mission node, a role and control", () => {
    expect(refusal("start", facts({}, { linkOpen: false }))).toBe("mission_no_link");
    expect(refusal("start", facts(null))).toBe("mission_silent");
    expect(refusal("start", facts({}, { isViewer: true }))).toBe("mission_viewer");
    expect(refusal("start", facts({}, { isHeldByOther: true }))).toBe("mission_held");
  });

  it("read lists of tags", () => {
    expect(readTagIds(" 4, 7;12\n4 ")).toEqual(["4", "7", "12", "4"]);
    expect(readTagIds("")).toEqual([]);
  });
});
