import { describe, expect, it } from "vitest";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { type DriveFacts, driveObstacles, motionObstacles, parseDriveStatus, parseEstopReasons, relocationObstacles } from "./can_drive";
import { progress, sentence } from "./sentence";

const MISSION = {
  lifecycle_state: "MONITORING",
  mission_phase: "NAVIGATING",
  current_target: "19",
  paused: false,
  targets_total: 12,
  targets_completed: 10,
  targets_failed: 1,
  targets_unreachable: 0,
  targets_skipped: 0,
  tags_discovered: 12,
  discovery_goal: 12,
} as lupin_msgs_MissionState;

const LIVE = { linkOpen: true, wasOpen: true, stopped: false, mission: MISSION, isMissionSilent: false, drivenByHand: false, heldAtZero: false };

describe("the sentence", () => {
  it("names the tag that the robot drives to", () => {
    expect(sentence(LIVE)).toEqual({ key: "driving_to", values: { tag: "19" }, tone: "active" });
    expect(sentence({ ...LIVE, mission: { ...MISSION, mission_phase: "SCANNING" } }).key).toBe("reading_tag");
  });

  it("puts link and stop before everything else", () => {
    expect(sentence({ ...LIVE, linkOpen: false }).key).toBe("link_lost");
    expect(sentence({ ...LIVE, linkOpen: false, wasOpen: false }).key).toBe("connecting");
    expect(sentence({ ...LIVE, stopped: true }).key).toBe("stopped");
  });

  it("does not guess what a silent mission does", () => {
    expect(sentence({ ...LIVE, mission: null, isMissionSilent: true })).toEqual({ key: "mission_is_silent", tone: "lost" });
  });

  it("says what keeps the mission from moving", () => {
    expect(sentence({ ...LIVE, drivenByHand: true }).key).toBe("mission_waits");
    expect(sentence({ ...LIVE, heldAtZero: true }).key).toBe("mission_held_at_zero");
    expect(sentence({ ...LIVE, heldAtZero: true, mission: { ...MISSION, paused: true } }).key).toBe("mission_paused");
  });

  it("says that the mission waits for a robot that is lost on the map", () => {
    expect(sentence({ ...LIVE, mission: { ...MISSION, last_error: "robot_lost" } })).toEqual({ key: "mission_robot_lost", tone: "attention" });
    expect(sentence({ ...LIVE, mission: { ...MISSION, last_error: "robot_found" } }).key).toBe("driving_to");
    expect(sentence({ ...LIVE, mission: { ...MISSION, last_error: "robot_lost", lifecycle_state: "READY" } }).key).toBe("mission_ready");
  });

  it("knows the robot without a mission", () => {
    expect(sentence({ ...LIVE, mission: null }).key).toBe("at_rest");
    expect(sentence({ ...LIVE, mission: null, drivenByHand: true }).key).toBe("driving_by_hand");
    expect(sentence({ ...LIVE, mission: { ...MISSION, lifecycle_state: "UNHEARD_OF" } }).key).toBe("at_rest");
  });

  it("counts what was tried, and discovered tags before there are targets", () => {
    expect(progress(MISSION)).toEqual({ done: 11, total: 12 });
    expect(progress({ ...MISSION, targets_total: 0, tags_discovered: 3 })).toEqual({ done: 3, total: 12 });
    expect(progress({ ...MISSION, lifecycle_state: "READY" })).toBeNull();
    const exploring = { ...MISSION, lifecycle_state: "EXPLORING", tags_discovered: 7 };
    expect(progress(exploring)).toEqual({ done: 7, total: 12 });
    expect(progress({ ...exploring, discovery_goal: 65_535, targets_total: 7 })).toBeNull();
  });
});

describe("can I drive?", () => {
  const FREE: DriveFacts = {
    linkOpen: true,
    isRewound: false,
    isWatching: false,
    role: "operator",
    holder: null,
    inControl: false,
    gateReason: null,
    estopReasons: [],
    missionDrives: false,
    bus: { winner: "zero", locks: [], alarms: [], sink: { topic: "/cmd_vel", listeners: 1 } },
  };

  it("has no obstacle on a free robot", () => {
    expect(driveObstacles(FREE)).toEqual([]);
  });

  it("names all obstacles, the nearest first", () => {
    const facts = { ...FREE, holder: "phone-2", estopReasons: ["button"], missionDrives: true, bus: { ...FREE.bus!, locks: ["e-stop engaged", "slam"] } };
    expect(motionObstacles(facts).map((reason) => reason.key)).toEqual(["why_estop", "why_control", "why_mission", "why_locked"]);
    expect(driveObstacles(facts).at(-1)?.values).toEqual({ reason: "slam" });
  });

  it("lets sticks override a mission, and goals not", () => {
    expect(driveObstacles({ ...FREE, missionDrives: true })).toEqual([]);
    expect(motionObstacles({ ...FREE, missionDrives: true })).toEqual([{ key: "why_mission" }]);
  });

  it("relocates a stopped robot, and none that a mission drives", () => {
    expect(relocationObstacles({ ...FREE, gateReason: "opened", estopReasons: ["button"], bus: null })).toEqual([]);
    expect(relocationObstacles({ ...FREE, missionDrives: true })).toEqual([{ key: "why_mission" }]);
    expect(relocationObstacles({ ...FREE, role: "viewer" })).toEqual([{ key: "why_viewer" }]);
  });

  it("says how a gate is opened that nothing else holds closed", () => {
    expect(driveObstacles({ ...FREE, gateReason: "opened" })[0]?.key).toBe("why_hold_first");
    expect(driveObstacles({ ...FREE, gateReason: "opened", estopReasons: ["button"] })[1]?.key).toBe("why_gate");
  });

  it("names a silent bus and wheels without a listener", () => {
    expect(driveObstacles({ ...FREE, bus: null })).toEqual([{ key: "why_no_bus" }]);
    const deaf = { ...FREE.bus!, sink: { topic: "/cmd_vel", listeners: 0 } };
    expect(driveObstacles({ ...FREE, bus: deaf })).toEqual([{ key: "why_no_wheels" }]);
  });

  it.each(["", "null", "[]", "{", '{"locks": 1, "sink": 2}'])("survives the status %s", (text) => {
    const status = parseDriveStatus(text);
    if (status !== null) expect(status.locks).toEqual([]);
    expect(parseEstopReasons(text)?.engaged ?? false).toBe(false);
  });
});
