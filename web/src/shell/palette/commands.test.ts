// @vitest-environment jsdom
import { beforeAll, describe, expect, it } from "vitest";
import { loadDutch, TEXT_KEYS, textIn } from "@/i18n/text";
import type { MissionFacts } from "@/map/mission_rules";
import { type CommandFacts, commandsFor } from "./commands";

const READY: MissionFacts = {
  linkOpen: true,
  isRewound: false,
  isViewer: false,
  isHeldByOther: false,
  isWatching: false,
  stopped: false,
  isGateClosed: false,
  mission: { lifecycle_state: "READY", paused: false, current_target: "", estop_engaged: false, battery_low: false },
};
const INSPECTING: MissionFacts = { ...READY, mission: { ...READY.mission!, lifecycle_state: "INSPECTING", current_target: "19" } };
const PAUSED: MissionFacts = { ...INSPECTING, mission: { ...INSPECTING.mission!, paused: true } };
const FREE: CommandFacts = {
  linkOpen: true,
  isRewound: false,
  mayCommand: true,
  hasControl: false,
  holder: null,
  isViewer: false,
  mission: READY,
  goalObstacle: null,
  navigates: false,
  presetObstacle: null,
  locations: { home: { x: 0, y: 0, yaw: 0 } },
  language: "en",
};
const obstacles = (facts: CommandFacts) => new Map(commandsFor(facts).map(({ id, obstacle }) => [id, obstacle]));

beforeAll(loadDutch);

describe("the palette's commands", () => {
  it("are confirmed where they end or replace what runs", () => {
    const ending = (facts: CommandFacts) => commandsFor(facts).flatMap(({ id, ends }) => (ends === undefined ? [] : [id]));
    expect(ending(FREE)).toEqual([]);
    expect(ending({ ...FREE, mission: INSPECTING })).toEqual(["skip", "abort"]);
    expect(ending({ ...FREE, navigates: true })).toEqual(["start exploration", "start inspection", "drive home"]);
  });

  it("have ids of their own and texts in both languages", () => {
    const commands = commandsFor({ ...FREE, mission: INSPECTING });
    expect(new Set(commands.map(({ id }) => id)).size).toBe(commands.length);
    for (const { group, label, valueKeys = {} } of commands) {
      for (const key of [group, label, ...Object.values(valueKeys)]) {
        expect(TEXT_KEYS).toContain(key);
        expect(textIn("nl", key)).not.toBe("");
      }
    }
  });

  it("follow the mission", () => {
    expect(obstacles(FREE).get("start exploration")).toBeNull();
    expect(obstacles(FREE).has("pause")).toBe(false);
    const active = obstacles({ ...FREE, mission: INSPECTING });
    expect([...active.keys()]).toEqual(expect.arrayContaining(["pause", "skip", "abort"]));
    expect(active.has("start exploration")).toBe(false);
    const paused = obstacles({ ...FREE, mission: { ...PAUSED, stopped: true } });
    expect(paused.get("resume")).toEqual({ key: "mission_release_first" });
    expect(paused.get("abort")).toBeNull();
  });

  it("can always stop, and say why they cannot move the robot", () => {
    const lost = obstacles({ ...FREE, linkOpen: false });
    expect(lost.get("stop")).toBeNull();
    expect(lost.get("light red")).toEqual({ key: "palette_no_link" });
    expect(obstacles({ ...FREE, mayCommand: false }).get("light red")).toEqual({ key: "palette_needs_control" });
  });

  it("have the obstacles of the buttons that do the same", () => {
    const blocked = obstacles({ ...FREE, goalObstacle: { key: "why_hold_first" }, presetObstacle: { key: "arm_why_torque_unknown" } });
    expect(blocked.get("drive home")).toEqual({ key: "why_hold_first" });
    expect(blocked.get("preset home")).toEqual({ key: "arm_why_torque_unknown" });
    expect(blocked.get("light red")).toBeNull();
    expect(obstacles({ ...FREE, mission: { ...READY, isGateClosed: true } }).get("start inspection")).toEqual({ key: "mission_hold_first" });
    expect(obstacles({ ...FREE, mission: { ...INSPECTING, isGateClosed: true } }).get("pause")).toBeNull();
  });

  it("offer the one step towards control", () => {
    expect(obstacles(FREE).has("take")).toBe(true);
    expect(obstacles({ ...FREE, holder: "phone-2" }).has("request")).toBe(true);
    expect(obstacles({ ...FREE, hasControl: true, holder: "laptop-1" }).has("give_up")).toBe(true);
    expect(obstacles({ ...FREE, isViewer: true }).get("take")).toEqual({ key: "you_are_viewer" });
  });
});
