/** The one sentence that says what the robot does, and the mission's progress beside it. */
import type { lupin_msgs_MissionState } from "@/generated/messages";
import type { TextKey, TextValues } from "@/i18n/text";
import type { Wheels } from "./wheels";

export interface Situation {
  linkOpen: boolean;
  wasOpen: boolean;
  /** The robot's e-stop; null where it is not known. */
  stopped: boolean | null;
  mission: lupin_msgs_MissionState | null;
  /** The mission's state has not come for a while; then `mission` is null. */
  isMissionSilent: boolean;
  /** The input that wins the drive bus. */
  winner: string | null;
  /** Navigation pursues a goal, whether or not it wins the drive bus. */
  navigates: boolean;
  wheels: Wheels;
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

/** What the robot does: no sentence claims rest that was not measured, or hides that the wheels turn. */
export function sentence(situation: Situation): Sentence {
  const { linkOpen, wasOpen, stopped, mission, isMissionSilent, navigates, wheels, heldAtZero } = situation;
  if (!linkOpen) return wasOpen ? { key: "link_lost", tone: "lost" } : { key: "connecting", tone: "calm" };
  const isTurning = wheels === "turning";
  if (stopped === true) return { key: isTurning ? "stopped_moving" : "stopped", tone: "stop" };
  if (stopped === null && !isTurning) return { key: "stop_unknown", tone: "lost" };
  if (mission !== null && isActive(mission)) return whileActive(mission, situation);
  // Other pages, too, may hold the manual input at zero.
  if (isByHand(situation) && wheels !== "standing") return { key: "driving_by_hand", tone: "active" };
  if (navigates && !heldAtZero && wheels !== "standing") return { key: "driving_to_goal", tone: "active" };
  if (isTurning) return { key: "robot_moving", tone: "attention" };
  if (navigates) return { key: "goal_waits", tone: "active" };
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
      return { key: wheels === "standing" ? "at_rest" : "ready", tone: "calm" };
  }
}

/** Whether a person drives. A page in control whose gate is engaged holds the manual input with zeros: that is no driving. */
function isByHand({ winner, heldAtZero }: Situation): boolean {
  return winner === "joy" || (winner === "manual" && !heldAtZero);
}

function whileActive(mission: lupin_msgs_MissionState, situation: Situation): Sentence {
  const isTurning = situation.wheels === "turning";
  const byHand = isByHand(situation);
  if (mission.paused) {
    if (!isTurning) return { key: "mission_paused", tone: "attention" };
    if (byHand) return { key: "mission_paused_by_hand", tone: "attention" };
    return situation.navigates && !situation.heldAtZero ? { key: "mission_paused_goal", tone: "active" } : { key: "mission_paused_moving", tone: "attention" };
  }
  if (byHand && isTurning) return { key: "mission_waits", tone: "attention" };
  const waits = isRobotLost(mission) ? "mission_robot_lost" : situation.heldAtZero ? "mission_held_at_zero" : null;
  if (waits !== null) return { key: isTurning ? "robot_moving" : waits, tone: "attention" };
  if (byHand) return { key: situation.wheels === "standing" ? "mission_held_by_hand" : "mission_waits", tone: "attention" };
  return { ...duringMission(mission), tone: "active" };
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
