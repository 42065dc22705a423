/**
 * What has happened in the run, as the server has it: it outlives the page.
 *
 * The history is asked for after the channel was opened, and each event has a number: none is missing in between, and none is
 * there twice. What concerns this browser and is new is also said, for which the reason is in the event.
 */
import { create } from "zustand";
import type { TextKey } from "@/i18n/text";
import { showInfo } from "@/state/problems";
import { getJson } from "./http";
import { type ConsoleEvent, useConsole } from "./console_store";

const MAX_EVENTS = 200;

/** The fields of a state of the mission by which its events are told. */
export interface PastState {
  header: { stamp: { sec: number; nanosec: number } };
  lifecycle_state: string;
  mission_phase: string;
  current_target: string;
  last_error: string;
  last_event: string;
  last_event_severity: number;
  estop_engaged: boolean;
  paused: boolean;
}

interface History {
  /** The oldest first. */
  events: readonly ConsoleEvent[];
  /** The mission's states that differed, the oldest first; null until the server has answered. */
  mission: readonly PastState[] | null;
}

export const useHistory = create<History>(() => ({ events: [], mission: null }));

/** The number of the last event that this page has said or need not say; null before the first answer. */
let heardUpTo: number | null = null;

/** Ask for what happened before, again after every outage: another server may have taken over. */
export async function loadHistory(): Promise<void> {
  try {
    const { events, mission } = await getJson<{ events: ConsoleEvent[]; mission: PastState[] }>("/_api/history");
    const last = events.at(-1)?.number ?? 0;
    if (heardUpTo === null || last < heardUpTo) heardUpTo = last;
    const later = useHistory.getState().events.filter(({ number }) => number > last);
    useHistory.setState({ events: [], mission });
    addEvents([...events, ...later]);
  } catch {
    // A server of an older version keeps none: events begin with this page.
    useHistory.setState(({ mission }) => ({ mission: mission ?? [] }));
  }
}

/** Add events that are not known yet, and say those that are new and concern this browser. */
export function addEvents(added: readonly ConsoleEvent[]): void {
  const known = new Set(useHistory.getState().events.map(({ number }) => number));
  const fresh = added.filter(({ number }) => !known.has(number));
  if (fresh.length === 0) return;
  useHistory.setState(({ events }) => ({ events: [...events, ...fresh].toSorted((a, b) => a.number - b.number).slice(-MAX_EVENTS) }));
  const upTo = heardUpTo;
  if (upTo === null) return;
  const name = useConsole.getState().session?.name;
  for (const event of fresh) {
    const notice = event.number > upTo && name !== undefined ? noticeOf(event, name) : null;
    if (notice !== null) showInfo(notice.key, { name: notice.name });
  }
  heardUpTo = Math.max(upTo, ...fresh.map(({ number }) => number));
}

/** What somebody at the browser `own` must be told of an event, with the name of the other one; null where it is not its. */
export function noticeOf({ kind, name, other }: ConsoleEvent, own: string): { key: TextKey; name: string } | null {
  const key = (name === own ? OWN[kind] : undefined) ?? (other === own ? OF_OTHERS[kind] : undefined);
  return key === undefined ? null : { key, name: name === own ? other : name };
}

const OWN: Record<string, TextKey> = {
  control_expired: "notice_control_expired",
  control_left: "notice_control_left",
  control_unanswered: "notice_control_unanswered",
  control_inherited: "notice_control_inherited",
};

const OF_OTHERS: Record<string, TextKey> = {
  control_taken_over: "notice_control_taken_over",
  control_passed: "notice_control_passed",
  control_kept: "notice_control_kept",
  control_expired: "notice_control_holder_expired",
};
