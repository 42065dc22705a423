// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { TEXT_KEYS, textIn } from "@/i18n/text";
import { type CommandFacts, commandsFor } from "./commands";

const READY = { lifecycle_state: "READY", paused: false, current_target: "" } as lupin_msgs_MissionState;
const INSPECTING = { lifecycle_state: "INSPECTING", paused: false, current_target: "19" } as lupin_msgs_MissionState;
const FREE: CommandFacts = {
  linkOpen: true,
  mayCommand: true,
  hasControl: false,
  holder: null,
  isViewer: false,
  stopped: false,
  mission: READY,
  locations: { home: { x: 0, y: 0, yaw: 0 } },
  language: "en",
};
const obstacles = (facts: CommandFacts) => new Map(commandsFor(facts).map(({ id, obstacle }) => [id, obstacle]));

describe("the palette's commands", () => {
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
    const paused = obstacles({ ...FREE, stopped: true, mission: { ...INSPECTING, paused: true } });
    expect(paused.get("resume")).toBe("palette_stopped");
    expect(paused.get("abort")).toBeNull();
  });

  it("can always stop, and say why they cannot move the robot", () => {
    const lost = obstacles({ ...FREE, linkOpen: false });
    expect(lost.get("stop")).toBeNull();
    expect(lost.get("drive home")).toBe("palette_no_link");
    expect(obstacles({ ...FREE, mayCommand: false }).get("preset home")).toBe("palette_needs_control");
    expect(obstacles({ ...FREE, stopped: true }).get("preset home")).toBe("palette_stopped");
    expect(obstacles({ ...FREE, stopped: true }).get("light red")).toBeNull();
  });

  it("offer the one step towards control", () => {
    expect(obstacles(FREE).has("take")).toBe(true);
    expect(obstacles({ ...FREE, holder: "phone-2" }).has("request")).toBe(true);
    expect(obstacles({ ...FREE, hasControl: true, holder: "laptop-1" }).has("give_up")).toBe(true);
    expect(obstacles({ ...FREE, isViewer: true }).get("take")).toBe("you_are_viewer");
  });
});
