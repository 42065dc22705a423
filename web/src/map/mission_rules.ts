/** Which request to the mission is possible now, and why not: as the robot will judge it. */
import { SERVICES } from "@/generated/graph";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import type { TextKey } from "@/i18n/text";
import { ACTIVE_STATES } from "@/state/sentence";

/** A discovery goal of this stands for all tags that can be found. */
export const ALL_TAGS = 65535;

export type MissionAction = "start" | "pause" | "resume" | "abort" | "skip" | "dock" | "reset";

export interface MissionFacts {
  linkOpen: boolean;
  /** The page shows the past. */
  isRewound: boolean;
  isViewer: boolean;
  /** Another session has control. */
  isHeldByOther: boolean;
  /** Another tab of this browser commands. */
  isWatching: boolean;
  /** The robot's e-stop; null while it is not known. */
  stopped: boolean | null;
  /** This page's own gate is closed: it sends nothing that can lead to motion. */
  isGateClosed: boolean;
  /** The mission's state; null where there is none, or where it is out of date. */
  mission: Pick<lupin_msgs_MissionState, "lifecycle_state" | "current_target" | "paused" | "estop_engaged" | "battery_low"> | null;
}

const RESUMABLE = ["EXPLORING", "INSPECTING", "MONITORING"];

/** The service of each action; of a start, the request has parameters. */
export const MISSION_SERVICES = {
  start: SERVICES.MISSION_START,
  pause: SERVICES.MISSION_PAUSE,
  resume: SERVICES.MISSION_RESUME,
  abort: SERVICES.MISSION_ABORT,
  skip: SERVICES.MISSION_SKIP,
  dock: SERVICES.MISSION_DOCK,
  reset: SERVICES.MISSION_RESET,
} as const;

/** Why an action is not possible; null where it is. */
export function refusal(action: MissionAction, facts: MissionFacts): TextKey | null {
  return obstacle(action, facts) ?? (facts.isGateClosed && MISSION_SERVICES[action].moves ? "mission_hold_first" : null);
}

function obstacle(action: MissionAction, facts: MissionFacts): TextKey | null {
  const { mission } = facts;
  if (facts.isRewound) return "rewind_no_command";
  if (!facts.linkOpen) return "mission_no_link";
  if (mission === null) return "mission_silent";
  if (facts.isViewer) return "mission_viewer";
  if (facts.isWatching) return "why_other_tab";
  if (facts.isHeldByOther) return "mission_held";
  const stopped = facts.stopped === true || mission.estop_engaged ? "mission_release_first" : facts.stopped === null ? "mission_stop_unknown" : null;
  const active = (ACTIVE_STATES as readonly string[]).includes(mission.lifecycle_state);
  switch (action) {
    case "start":
      if (active) return "mission_running";
      if (mission.lifecycle_state === "FAULT") return "mission_reset_first";
      if (mission.lifecycle_state !== "READY" && mission.lifecycle_state !== "DONE") return "mission_not_ready";
      if (stopped !== null) return stopped;
      return mission.battery_low ? "mission_charge_first" : null;
    case "pause":
      if (!active) return "mission_none_running";
      if (mission.paused) return "mission_is_paused";
      return mission.lifecycle_state === "RETURNING" && mission.battery_low ? "mission_returns_to_charge" : null;
    case "resume":
      if (!active || !mission.paused) return "mission_not_paused";
      if (stopped !== null) return stopped;
      return mission.battery_low && mission.lifecycle_state !== "RETURNING" ? "mission_charge_first" : null;
    case "abort":
      if (!active) return "mission_none_running";
      return mission.lifecycle_state === "RETURNING" && mission.battery_low && !mission.paused ? "mission_returns_to_charge" : null;
    case "skip":
      return mission.lifecycle_state === "INSPECTING" && mission.current_target !== "" ? null : "mission_skip_in_inspection";
    case "dock":
      if (!RESUMABLE.includes(mission.lifecycle_state)) return "mission_dock_while_active";
      return stopped;
    case "reset":
      return mission.lifecycle_state === "FAULT" ? null : "mission_reset_in_fault";
  }
}

/** What an action ends or gives up, which a person confirms, be it by holding a button; null where it ends nothing. */
export const ENDS: Readonly<Record<MissionAction, TextKey | null>> = {
  start: null,
  pause: null,
  resume: null,
  abort: "mission_abort_hint",
  skip: "mission_skip_hint",
  dock: "mission_dock_hint",
  reset: null,
};

/** The tag ids of a text, divided by commas or spaces; duplicates are kept, since a mission may visit a tag twice. */
export function readTagIds(text: string): string[] {
  return text.split(/[\s,;]+/).filter((id) => id !== "");
}
