/** What happened in missions since this page was opened. It goes on while other tabs are shown. */
import { create } from "zustand";
import { TOPICS } from "@/generated/graph";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { topics } from "@/robot";
import { MAX_EVENTS, type MissionEvent, type Visit, eventsBetween, observationEvent, observationKey, visitOf } from "./events";
import { RecentKeys } from "./recent_keys";

const MAX_VISITS = 1000;
/** Of far more observations than a late subscriber is sent again. */
const MAX_KNOWN = 2000;

export interface LoggedEvent extends MissionEvent {
  number: number;
}

interface MissionLog {
  /** The newest one first. */
  events: LoggedEvent[];
  /** In their order. */
  visits: Visit[];
  /** The sequence of the inspection that this page started, by the mission's id. */
  requested: { missionId: string; tags: string[] } | null;
}

export const useMissionLog = create<MissionLog>(() => ({ events: [], visits: [], requested: null }));

let number = 0;
let isStarted = false;

function add(events: readonly MissionEvent[]): void {
  if (events.length === 0) return;
  const logged = events.map((event) => ({ ...event, number: (number += 1) }));
  useMissionLog.setState((log) => {
    // Latched observations of the past arrive after the state of now.
    const all = [...logged.toReversed(), ...log.events].toSorted((a, b) => b.timeS - a.timeS || b.number - a.number);
    return { events: all.slice(0, MAX_EVENTS) };
  });
}

/** Begin to listen; called once, at the first look at the map. */
export function startMissionLog(): void {
  if (isStarted) return;
  isStarted = true;
  let state: lupin_msgs_MissionState | null = null;
  topics.listen(TOPICS.MISSION_STATE, {}, () => {
    const next = topics.last(TOPICS.MISSION_STATE)?.message;
    if (next === undefined) return;
    add(eventsBetween(state, next));
    state = next;
  });
  const known = new RecentKeys(MAX_KNOWN);
  topics.listen(TOPICS.OBSERVATIONS, {}, () => {
    const observation = topics.last(TOPICS.OBSERVATIONS)?.message;
    if (observation === undefined) return;
    if (!known.add(observationKey(observation))) return;
    const event = observationEvent(observation);
    if (event !== null) add([event]);
    const visit = visitOf(observation);
    if (visit !== null) useMissionLog.setState((log) => ({ visits: [...log.visits, visit].slice(-MAX_VISITS) }));
  });
}
