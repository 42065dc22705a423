/** The mission as a transit line whose stops are tags: visited, current, next, still open. */
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { lupin_msgs_Observation as OBSERVATION } from "@/generated/messages";
import type { Visit } from "./events";
import { type Tag, compareIds } from "./twin";
import type { Point } from "./view";

export type StopState = "done" | "failed" | "skipped" | "current" | "next" | "open";

export interface Stop {
  /** The tag's id; "" where only the number of stops is known. */
  tag: string;
  state: StopState;
  /** The robot's time of the visit, s. */
  timeS?: number;
}

/** What a round of visits is called in observations, by the state of the mission. */
const ROUND_SOURCE: Record<string, string> = {
  EXPLORING: "ExplorationMission",
  INSPECTING: "InspectionMission",
  MONITORING: "MonitoringMission",
};

/** What of the mission's state the line is made of. */
export type LineState = Pick<lupin_msgs_MissionState, "mission_id" | "lifecycle_state" | "current_target" | "targets_total"> & {
  /** How many visits the robot counts, of whatever result. */
  visited: number;
};

/** More stops than this are not drawn one by one. */
const MAX_STOPS = 200;

/** The stops in their order. `requested` is the sequence of an inspection that this page started. */
export function transitStops(
  mission: LineState | null,
  visits: readonly Visit[],
  tags: readonly Tag[],
  requested: readonly string[] = [],
): Stop[] {
  if (mission === null || mission.mission_id === "") return [];
  const own = visits.filter((visit) => visit.missionId === mission.mission_id);
  const source = ROUND_SOURCE[mission.lifecycle_state] ?? lastSource(own);
  const done = lastRound(own.filter((visit) => visit.source === source), mission, source);
  // An observation may come before the state that leaves its tag.
  if (mission.current_target !== "" && done.at(-1)?.tag === mission.current_target) done.pop();
  const unseen = Math.min(MAX_STOPS, Math.max(0, visitedInRound(mission, source) - done.length));
  const stops: Stop[] = [
    ...Array.from({ length: unseen }, () => ({ tag: "", state: "done" as const })),
    ...done.map(({ tag, status, timeS }) => ({ tag, state: stateOf(status), timeS })),
  ];
  const current = mission.current_target;
  if (current !== "") stops.push({ tag: current, state: "current" });
  const isOver = mission.lifecycle_state === "RETURNING" || mission.lifecycle_state === "DONE" || mission.lifecycle_state === "FAULT";
  if (!isOver) stops.push(...openStops(mission, stops, tags, requested, source));
  return stops.slice(0, MAX_STOPS);
}

function stateOf(status: number): StopState {
  if (status === OBSERVATION.STATUS_OK) return "done";
  return status === OBSERVATION.STATUS_SKIPPED ? "skipped" : "failed";
}

function lastSource(visits: readonly Visit[]): string {
  return visits.at(-1)?.source ?? "";
}

/** The visits of the round that is under way; one round after the other visits the same tags. */
function lastRound(visits: readonly Visit[], mission: LineState, source: string): Visit[] {
  if (source !== "MonitoringMission" || !(mission.targets_total > 0)) return [...visits];
  const count = inRound(visits.length, mission);
  return count === 0 ? [] : visits.slice(-count);
}

function inRound(count: number, mission: LineState): number {
  const rest = count % mission.targets_total;
  return rest === 0 && count > 0 && mission.lifecycle_state !== "MONITORING" ? mission.targets_total : rest;
}

/** The visits that the robot counts in this round: more than were seen where this page was opened later. */
function visitedInRound(mission: LineState, source: string): number {
  if (!(mission.visited > 0)) return 0;
  if (source === "MonitoringMission") return mission.targets_total > 0 ? inRound(mission.visited, mission) : 0;
  // While exploring, discovered tags are counted, and not those that were read.
  return source === "InspectionMission" ? mission.visited : 0;
}

function openStops(
  mission: LineState,
  before: readonly Stop[],
  tags: readonly Tag[],
  requested: readonly string[],
  source: string,
): Stop[] {
  const visited = new Set(before.map((stop) => stop.tag));
  if (source === "MonitoringMission") return ordered(nearestOrder(tags, visited, mission.current_target), true);
  if (source === "InspectionMission") {
    if (requested.length > 0) return ordered(requested.slice(before.length), true);
    const left = mission.targets_total - before.length;
    const known = tags.map((tag) => tag.id).filter((id) => !visited.has(id)).toSorted(compareIds);
    // The robot was given a list that this page does not know.
    if (known.length !== left) return Array.from({ length: Math.max(0, left) }, () => ({ tag: "", state: "open" as const }));
    return ordered(known, true);
  }
  return ordered(tags.map((tag) => tag.id).filter((id) => !visited.has(id)).toSorted(compareIds), false);
}

function ordered(ids: readonly string[], isOrderKnown: boolean): Stop[] {
  return ids.map((tag, index) => ({ tag, state: isOrderKnown && index === 0 ? "next" : "open" }));
}

/** The order in which monitoring visits tags: always the nearest of those left, equal ones by id. */
export function nearestOrder(tags: readonly Tag[], visited: ReadonlySet<string>, from: string): string[] {
  const left = tags.filter((tag) => !visited.has(tag.id)).toSorted((a, b) => compareIds(a.id, b.id));
  const order: string[] = [];
  let current: Point | null = tags.find((tag) => tag.id === from)?.at ?? null;
  while (current !== null) {
    let [best, bestDistance] = [null as Tag | null, Infinity];
    for (const tag of left) {
      if (tag.at === null || order.includes(tag.id)) continue;
      const distance = (tag.at.x - current.x) ** 2 + (tag.at.y - current.y) ** 2;
      if (distance < bestDistance) [best, bestDistance] = [tag, distance];
    }
    if (best === null) break;
    order.push(best.id);
    current = best.at;
  }
  return [...order, ...left.map((tag) => tag.id).filter((id) => !order.includes(id))];
}
