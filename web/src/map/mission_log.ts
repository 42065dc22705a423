/** What happened in this run: from the server's history, and since this page was opened. It goes on while other tabs are shown. */
import { create } from "zustand";
import { type PastState, useHistory } from "@/api/history";
import { TOPICS } from "@/generated/graph";
import { topics } from "@/robot/link";
import { MAX_EVENTS, type MissionEvent, type Visit, consoleEvent, eventsBetween, observationEvent, observationKey, seconds, visitOf } from "./events";
import { RecentKeys } from "./recent_keys";

const MAX_VISITS = 1000;
/** Of far more observations than a late subscriber is sent again. */
const MAX_KNOWN = 2000;

export interface LoggedEvent extends MissionEvent {
  number: number;
}

/** An event, and how often it came in a row; it is the newest of them. */
export interface RepeatedEvent {
  event: LoggedEvent;
  count: number;
}

/** Events in a row of the same kind and text as one. */
export function collapseEvents(events: readonly LoggedEvent[]): RepeatedEvent[] {
  const rows: RepeatedEvent[] = [];
  for (const event of events) {
    const last = rows.at(-1);
    if (last !== undefined && last.event.kind === event.kind && JSON.stringify(last.event.text) === JSON.stringify(event.text)) last.count += 1;
    else rows.push({ event, count: 1 });
  }
  return rows;
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

/** The events of the mission's states: of the past, which may come again after an outage, and of now. */
export class StateEvents {
  private last: PastState | null = null;

  /** A state of the past: what was seen already makes no events. */
  takePast(state: PastState): MissionEvent[] {
    return this.last !== null && seconds(state.header.stamp) <= seconds(this.last.header.stamp) ? [] : this.take(state);
  }

  take(state: PastState): MissionEvent[] {
    const before = this.last;
    this.last = state;
    return eventsBetween(before, state);
  }
}

/** Begin to listen; called once, at the first look at the map. */
export function startMissionLog(): void {
  if (isStarted) return;
  isStarted = true;
  const states = new StateEvents();
  topics.listen(TOPICS.MISSION_STATE, {}, () => {
    const next = topics.last(TOPICS.MISSION_STATE)?.message;
    // The state is repeated: what is not looked at before the history has come is compared with it soon after.
    if (next !== undefined && useHistory.getState().mission !== null) add(states.take(next));
  });
  const heard = new RecentKeys(MAX_KNOWN);
  const takeHistory = () => {
    const { events, mission } = useHistory.getState();
    add([
      ...(mission ?? []).flatMap((state) => states.takePast(state)),
      ...events.filter(({ number: count, robot_s, kind }) => heard.add(`${count} ${robot_s} ${kind}`)).map(consoleEvent),
    ]);
  };
  takeHistory();
  useHistory.subscribe(takeHistory);
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
