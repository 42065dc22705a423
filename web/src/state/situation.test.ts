import { describe, expect, it } from "vitest";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { shell } from "@/i18n/catalog/en/shell";
import { type DriveFacts, driveAnswer, driveObstacles, motionObstacles, parseDriveStatus, parseEstopReasons, relocationObstacles } from "./can_drive";
import { type Situation, progress, sentence } from "./sentence";

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

const LIVE: Situation = {
  linkOpen: true,
  wasOpen: true,
  stopped: false,
  mission: MISSION,
  isMissionSilent: false,
  winner: null,
  navigates: false,
  wheels: "standing",
  heldAtZero: false,
};
const BY_HAND = { ...LIVE, winner: "manual", wheels: "turning" } as const;

const WINNERS = ["joy", "manual", "auto", "zero", null];
const WHEELS = ["turning", "standing", "unknown"] as const;
const BOOLEANS = [false, true];
const MISSIONS = [
  null,
  ...["BOOT", "READY", "DONE", "FAULT", "UNHEARD_OF", "PREPARE", "EXPLORING", "INSPECTING", "RETURNING"].flatMap((lifecycle_state) =>
    BOOLEANS.flatMap((paused) => ["", "robot_lost"].map((last_error) => ({ ...MISSION, lifecycle_state, paused, last_error }))),
  ),
];

/** Every situation with an open link. */
function* situations(): Generator<Situation> {
  for (const stopped of [null, false, true])
    for (const mission of MISSIONS)
      for (const isMissionSilent of mission === null ? BOOLEANS : [false])
        for (const winner of stopped ? [null] : WINNERS)
          for (const heldAtZero of winner === "manual" ? BOOLEANS : [false])
            for (const navigates of winner === "auto" ? [true] : BOOLEANS)
              for (const wheels of WHEELS) yield { ...LIVE, stopped, mission, isMissionSilent, winner, heldAtZero, navigates, wheels };
}

/** The situations in which the sentence breaks a rule, as text. */
function violations(isBroken: (situation: Situation, text: string) => boolean): string[] {
  return [...situations()].filter((each) => isBroken(each, shell[sentence(each).key as keyof typeof shell])).map((each) => JSON.stringify(each));
}

describe("every sentence", () => {
  it("claims rest only of wheels that were measured at rest", () => {
    expect(violations(({ wheels }, text) => /stand|^Manual input/.test(text) && wheels !== "standing")).toEqual([]);
  });

  it("says neither ready nor idle while the wheels turn, and shows the motion of an idle robot", () => {
    const atRest = /^(Ready|Starting up|Mission (done|ended|paused$)|Waiting|Stopped$|Lost on the map|This page holds|.*is silent)/;
    expect(violations(({ wheels }, text) => wheels === "turning" && atRest.test(text))).toEqual([]);
  });

  it("says ready only while nothing pursues a goal", () => {
    expect(violations(({ navigates }, text) => navigates && text.startsWith("Ready"))).toEqual([]);
  });

  it("is loud while wheels turn that nobody is known to drive, and after a stop", () => {
    expect(violations((each, text) => text.includes("moving") && sentence(each).tone !== "attention")).toEqual([]);
    expect(violations((each) => each.stopped === true && sentence(each).tone !== "stop")).toEqual([]);
  });

  it("says that a person drives only while such an input wins and the wheels are not at rest", () => {
    const isFalse = ({ winner, wheels, heldAtZero }: Situation) => (winner !== "joy" && winner !== "manual") || heldAtZero || wheels === "standing";
    expect(violations((each, text) => /(by hand|^Driven by)/i.test(text) && isFalse(each))).toEqual([]);
  });
});

describe("the sentence", () => {
  it("names the tag that the robot drives to", () => {
    expect(sentence(LIVE)).toEqual({ key: "driving_to", values: { tag: "19" }, tone: "active" });
    expect(sentence({ ...LIVE, mission: { ...MISSION, mission_phase: "SCANNING" } }).key).toBe("reading_tag");
  });

  it("puts link and stop before everything else", () => {
    expect(sentence({ ...LIVE, linkOpen: false }).key).toBe("link_lost");
    expect(sentence({ ...LIVE, linkOpen: false, wasOpen: false }).key).toBe("connecting");
    expect(sentence({ ...LIVE, stopped: true }).key).toBe("stopped");
    expect(sentence({ ...LIVE, stopped: true, wheels: "turning" })).toEqual({ key: "stopped_moving", tone: "stop" });
  });

  it("does not pass off an unknown stop as a released one", () => {
    for (const mission of MISSIONS)
      for (const wheels of ["standing", "unknown"] as const) expect(sentence({ ...LIVE, stopped: null, mission, wheels })).toEqual({ key: "stop_unknown", tone: "lost" });
    expect(sentence({ ...LIVE, stopped: null, wheels: "turning" }).key).toBe("driving_to");
  });

  it("does not guess what a silent mission does", () => {
    expect(sentence({ ...LIVE, mission: null, isMissionSilent: true })).toEqual({ key: "mission_is_silent", tone: "lost" });
  });

  it("says what keeps the mission from moving", () => {
    expect(sentence(BY_HAND).key).toBe("mission_waits");
    expect(sentence({ ...BY_HAND, wheels: "standing" }).key).toBe("mission_held_by_hand");
    expect(sentence({ ...LIVE, winner: "manual", heldAtZero: true }).key).toBe("mission_held_at_zero");
    const paused = { ...MISSION, paused: true };
    expect(sentence({ ...LIVE, winner: "manual", heldAtZero: true, mission: paused }).key).toBe("mission_paused");
    expect(sentence({ ...BY_HAND, mission: paused }).key).toBe("mission_paused_by_hand");
    expect(sentence({ ...LIVE, wheels: "turning", mission: paused }).key).toBe("mission_paused_moving");
    expect(sentence({ ...LIVE, wheels: "turning", navigates: true, mission: paused }).key).toBe("mission_paused_goal");
  });

  it("says that the mission waits for a robot that is lost on the map", () => {
    expect(sentence({ ...LIVE, mission: { ...MISSION, last_error: "robot_lost" } })).toEqual({ key: "mission_robot_lost", tone: "attention" });
    expect(sentence({ ...LIVE, mission: { ...MISSION, last_error: "robot_found" } }).key).toBe("driving_to");
    expect(sentence({ ...LIVE, mission: { ...MISSION, last_error: "robot_lost", lifecycle_state: "READY" } }).key).toBe("mission_ready");
  });

  it("knows the robot without a mission", () => {
    expect(sentence({ ...LIVE, mission: null }).key).toBe("at_rest");
    expect(sentence({ ...LIVE, mission: null, wheels: "unknown" }).key).toBe("ready");
    expect(sentence({ ...BY_HAND, mission: null }).key).toBe("driving_by_hand");
    expect(sentence({ ...LIVE, mission: { ...MISSION, lifecycle_state: "UNHEARD_OF" } }).key).toBe("at_rest");
  });

  it("says that navigation drives to a goal of no mission", () => {
    const goal = { ...LIVE, mission: { ...MISSION, lifecycle_state: "READY" }, winner: "auto", navigates: true };
    expect(sentence({ ...goal, wheels: "turning" })).toEqual({ key: "driving_to_goal", tone: "active" });
    expect(sentence({ ...goal, winner: null }).key).toBe("goal_waits");
    expect(sentence({ ...goal, winner: "zero", navigates: false, wheels: "turning" })).toEqual({ key: "robot_moving", tone: "attention" });
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
    inWords: (words) => words,
    linkOpen: true,
    isRewound: false,
    isWatching: false,
    role: "operator",
    holder: null,
    inControl: false,
    gateReason: null,
    estopReasons: [],
    isStopKnown: true,
    missionDrives: false,
    isMissionSilent: false,
    navigates: false,
    bus: { winner: "zero", locks: [], alarms: [], sink: { topic: "/cmd_vel", listeners: 1 } },
  };

  it("has no obstacle on a free robot", () => {
    expect(driveObstacles(FREE)).toEqual([]);
  });

  it("promises a robot at rest only if nothing drives on", () => {
    for (const winner of WINNERS)
      for (const missionDrives of BOOLEANS)
        for (const isMissionSilent of BOOLEANS)
          for (const navigates of BOOLEANS) {
            const answer = driveAnswer({ ...FREE, missionDrives, isMissionSilent, navigates, bus: { ...FREE.bus!, winner } });
            const drivesOn = missionDrives || isMissionSilent || navigates || winner === "auto" || winner === "joy";
            expect(answer === "can_drive_yes").toBe(!drivesOn);
          }
    expect(driveAnswer({ ...FREE, navigates: true, bus: { ...FREE.bus!, winner: "manual" } })).toBe("can_drive_over_goal");
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

  it("moves nothing while it is not known whether the robot is stopped", () => {
    expect(driveObstacles({ ...FREE, isStopKnown: false })).toEqual([{ key: "why_stop_unknown" }]);
    expect(relocationObstacles({ ...FREE, isStopKnown: false })).toEqual([]);
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
