/** The one sentence that says what the robot does, and the mission's progress beside it. */
import type { lupin_msgs_MissionState } from "@/generated/messages";
import type { TextKey, TextValues } from "@/i18n/text";

export interface Situation {
  linkOpen: boolean;
  wasOpen: boolean;
  /** The robot's e-stop; null before it was received. */
  stopped: boolean | null;
  mission: lupin_msgs_MissionState | null;
  /** The mission's state has not come for a while; then `mission` is null. */
  isMissionSilent: boolean;
  drivenByHand: boolean;
  /** This page sends zero velocity, which has a higher priority than the mission. */
  heldAtZero: boolean;
}

export interface Sentence {
  key: TextKey;
  values?: TextValues;
  tone: "calm" | "active" | "attention" | "stop" | "lost";
}

export const ACTIVE_STATES = ["PREPARE", "EXPLORING", "INSPECTING", "MONITORING", "RETURNING"] as const;

export function isActive(mission: Pick<lupin_msgs_MissionState, "lifecycle_state"> | null): boolean {
  return mission !== null && (ACTIVE_STATES as readonly string[]).includes(mission.lifecycle_state);
}

/** Whether the mission waits until the robot is found on the map. */
export function isRobotLost(mission: lupin_msgs_MissionState | null): boolean {
  return mission !== null && isActive(mission) && mission.last_error === "robot_lost";
}

export function sentence(situation: Situation): Sentence {
  const { linkOpen, wasOpen, stopped, mission, isMissionSilent, drivenByHand, heldAtZero } = situation;
  if (!linkOpen) return wasOpen ? { key: "link_lost", tone: "lost" } : { key: "connecting", tone: "calm" };
  if (stopped === true) return { key: "stopped", tone: "stop" };
  if (mission !== null && isActive(mission)) {
    if (mission.paused) return { key: "mission_paused", tone: "attention" };
    if (isRobotLost(mission)) return { key: "mission_robot_lost", tone: "attention" };
    if (heldAtZero) return { key: "mission_held_at_zero", tone: "attention" };
    if (drivenByHand) return { key: "mission_waits", tone: "attention" };
    return { ...duringMission(mission), tone: "active" };
  }
  if (drivenByHand) return { key: "driving_by_hand", tone: "active" };
  if (isMissionSilent) return { key: "mission_is_silent", tone: "lost" };
  switch (mission?.lifecycle_state) {
    case "BOOT":
      return { key: "mission_booting", tone: "calm" };
    case "READY":
      return { key: "mission_ready", tone: "calm" };
    case "DONE":
      return { key: "mission_done", tone: "calm" };
    case "FAULT":
      return { key: "mission_fault", tone: "attention" };
    default:
      return { key: "at_rest", tone: "calm" };
  }
}

function duringMission(mission: lupin_msgs_MissionState): { key: TextKey; values?: TextValues } {
  const { lifecycle_state: state, mission_phase: phase, current_target: tag } = mission;
  if (state === "RETURNING") return { key: "returning" };
  if (phase === "LOCALIZING") return { key: "localizing" };
  if (tag !== "") return { key: phase === "NAVIGATING" || phase === "" ? "driving_to" : "reading_tag", values: { tag } };
  return { key: state === "PREPARE" ? "mission_preparing" : "exploring" };
}

/** The goal of an exploration that seeks all tags. */
const EVERY_TAG = 65_535;

/** How many of how many tags are done; null if the mission counts none. */
export function progress(mission: lupin_msgs_MissionState | null): { done: number; total: number } | null {
  if (mission === null || !isActive(mission)) return null;
  if (mission.lifecycle_state === "EXPLORING") {
    // How many tags there are is not known while the robot looks for all of them.
    const isCounted = mission.discovery_goal > 0 && mission.discovery_goal < EVERY_TAG;
    return isCounted ? { done: mission.tags_discovered, total: mission.discovery_goal } : null;
  }
  if (mission.targets_total > 0) {
    const tried = mission.targets_failed + mission.targets_unreachable + mission.targets_skipped;
    return { done: mission.targets_completed + tried, total: mission.targets_total };
  }
  return mission.discovery_goal > 0 ? { done: mission.tags_discovered, total: mission.discovery_goal } : null;
}
