/** What happened, from the changes of the mission's state, from observations, and from what the console's server has decided. */
import type { ConsoleEvent } from "@/api/console_store";
import type { PastState } from "@/api/history";
import type { lupin_msgs_Observation } from "@/generated/messages";
import { lupin_msgs_MissionState as STATE, lupin_msgs_Observation as OBSERVATION } from "@/generated/messages";
import type { TextKey, TextValues } from "@/i18n/text";
import { inNaturalUnit } from "./health";

/** The event list keeps this many events. */
export const MAX_EVENTS = 200;

export type EventKind = "lifecycle" | "phase" | "target" | "pause" | "estop" | "control" | "fault" | "observation" | "notice";

export interface MissionEvent {
  kind: EventKind;
  /** The robot's time, s. */
  timeS: number;
  severity: "info" | "warn" | "error";
  /** A text of the catalog, or what the robot wrote. */
  text: { key: TextKey; values?: TextValues } | { raw: string };
  /** The tag that it is about. */
  tag?: string;
}

export function seconds(stamp: { sec: number; nanosec: number }): number {
  return stamp.sec + stamp.nanosec / 1e9;
}

const LIFECYCLE: Record<string, TextKey> = {
  BOOT: "mission_event_boot",
  READY: "mission_event_ready",
  PREPARE: "mission_event_prepare",
  EXPLORING: "mission_event_exploring",
  INSPECTING: "mission_event_inspecting",
  MONITORING: "mission_event_monitoring",
  RETURNING: "mission_event_returning",
  DONE: "mission_event_done",
  FAULT: "mission_event_fault",
};

const PHASES: Record<string, TextKey> = {
  LOCALIZING: "mission_event_localizing",
  NAVIGATING: "mission_event_navigating",
  SCANNING: "mission_event_scanning",
  CONFIRMING: "mission_event_confirming",
  PUBLISHING: "mission_event_publishing",
};

/** The events between two states. The first state that is seen makes none: when it began is not known. */
export function eventsBetween(before: PastState | null, after: PastState): MissionEvent[] {
  if (before === null) return [];
  const timeS = seconds(after.header.stamp);
  const events: MissionEvent[] = [];
  const changed = (field: keyof PastState) => before[field] !== after[field];
  if (changed("lifecycle_state")) {
    const key = LIFECYCLE[after.lifecycle_state];
    const isFault = after.lifecycle_state === "FAULT";
    events.push({
      kind: isFault ? "fault" : "lifecycle",
      timeS,
      severity: isFault ? "error" : "info",
      text: key === undefined ? { raw: after.lifecycle_state } : { key },
    });
  }
  if (changed("estop_engaged")) {
    const engaged = after.estop_engaged;
    events.push({ kind: "estop", timeS, severity: engaged ? "warn" : "info", text: { key: engaged ? "mission_event_stopped" : "mission_event_released" } });
  }
  if (changed("paused")) {
    events.push({ kind: "pause", timeS, severity: "info", text: { key: after.paused ? "mission_event_paused" : "mission_event_resumed" } });
  }
  if (changed("current_target") && after.current_target !== "") {
    const tag = after.current_target;
    events.push({ kind: "target", timeS, severity: "info", tag, text: { key: "mission_event_target", values: { tag } } });
  }
  if (changed("mission_phase") && after.mission_phase !== "") {
    const key = PHASES[after.mission_phase];
    events.push({ kind: "phase", timeS, severity: "info", text: key === undefined ? { raw: after.mission_phase } : { key } });
  }
  if (changed("last_error") && after.last_event !== "") {
    const isFault = after.last_event_severity >= STATE.SEVERITY_ERROR;
    const severity = isFault ? "error" : after.last_event_severity === STATE.SEVERITY_WARN ? "warn" : "info";
    events.push({ kind: isFault ? "fault" : "notice", timeS, severity, text: { raw: after.last_event } });
  }
  return events;
}

const FAILURES: Record<number, TextKey> = {
  [OBSERVATION.STATUS_UNREACHABLE]: "mission_event_unreachable",
  [OBSERVATION.STATUS_SCAN_FAILED]: "mission_event_scan_failed",
  [OBSERVATION.STATUS_SKIPPED]: "mission_event_skipped",
};

/** The event of an observation; null for kinds that are not known. */
export function observationEvent(observation: lupin_msgs_Observation): MissionEvent | null {
  const { kind, status, status_detail: detail } = observation;
  const base = { kind: "observation" as const, timeS: seconds(observation.header.stamp) };
  if (kind === OBSERVATION.KIND_TAG_READING) {
    const tag = observation.tag_reading.tag_id;
    if (status === OBSERVATION.STATUS_OK) {
      const count = observation.tag_reading.readings.length;
      return { ...base, severity: "info", tag, text: { key: "mission_event_read", values: { tag, count } } };
    }
    const key = FAILURES[status] ?? "mission_event_scan_failed";
    return { ...base, severity: status === OBSERVATION.STATUS_SKIPPED ? "info" : "warn", tag, text: { key, values: { tag, detail } } };
  }
  if (kind === OBSERVATION.KIND_FLOWER) {
    const { tag_id: tag, flower_count: flowers, bug_count: bugs, anomaly } = observation.flower;
    const key = anomaly || bugs > 0 ? "mission_event_bug" : "mission_event_flowers";
    return { ...base, severity: key === "mission_event_bug" ? "warn" : "info", tag, text: { key, values: { tag, flowers } } };
  }
  if (kind === OBSERVATION.KIND_ANOMALY) {
    return { ...base, severity: "warn", text: { raw: observation.anomaly.description } };
  }
  return null;
}

const CONSOLE_EVENTS: Record<string, TextKey> = {
  stop_pressed: "mission_event_stop_pressed",
  stop_left: "mission_event_stop_left",
  stop_lost_driving: "mission_event_stop_lost_driving",
  stop_lost_holding: "mission_event_stop_lost_holding",
  stop_lost_in_control: "mission_event_stop_lost_in_control",
  stop_not_back: "mission_event_stop_not_back",
  stop_silent: "mission_event_stop_not_back",
  stop_withdrawn: "mission_event_stop_withdrawn",
  stop_released: "mission_event_stop_released",
  control_taken: "mission_event_control_taken",
  control_taken_over: "mission_event_control_taken_over",
  control_requested: "mission_event_control_requested",
  control_kept: "mission_event_control_kept",
  control_unanswered: "mission_event_control_unanswered",
  control_request_withdrawn: "mission_event_control_request_withdrawn",
  control_passed: "mission_event_control_passed",
  control_given_up: "mission_event_control_given_up",
  control_inherited: "mission_event_control_inherited",
  control_left: "mission_event_control_left",
  control_expired: "mission_event_control_expired",
};

/** The event of a stop or of control; in the words of its kind where the page is older than the server. */
export function consoleEvent({ robot_s: timeS, kind, name, other }: ConsoleEvent): MissionEvent {
  const key = CONSOLE_EVENTS[kind];
  const isStop = kind.startsWith("stop_");
  const isEnd = kind === "stop_withdrawn" || kind === "stop_released";
  const text = key === undefined ? { raw: `${kind} ${name} ${other}`.trim() } : { key, values: { name, other } };
  return { kind: isStop ? "estop" : "control", timeS, severity: isStop && !isEnd ? "warn" : "info", text };
}

/** One visit to a tag, or one reading of it on the way. */
export interface Visit {
  tag: string;
  missionId: string;
  /** The kind of mission that read it. */
  source: string;
  status: number;
  timeS: number;
  /** In natural units. */
  readings: { name: string; value: number }[];
}

export function visitOf(observation: lupin_msgs_Observation): Visit | null {
  if (observation.kind !== OBSERVATION.KIND_TAG_READING || observation.tag_reading.tag_id === "") return null;
  return {
    tag: observation.tag_reading.tag_id,
    missionId: observation.mission_id,
    source: observation.source,
    status: observation.status,
    timeS: seconds(observation.header.stamp),
    readings: observation.tag_reading.readings.map(({ name, value }) => ({ name, value: inNaturalUnit(name, value) })),
  };
}

/** Observations are latched: after a reconnect the last ones arrive again. */
export function observationKey(observation: lupin_msgs_Observation): string {
  const { header, kind, source, tag_reading, flower } = observation;
  return [header.stamp.sec, header.stamp.nanosec, kind, source, tag_reading.tag_id, flower.tag_id].join(" ");
}
