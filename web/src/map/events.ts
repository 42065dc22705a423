/** What happened during a mission, from the changes of its state and from observations. */
import type { lupin_msgs_MissionState, lupin_msgs_Observation } from "@/generated/messages";
import { lupin_msgs_MissionState as STATE, lupin_msgs_Observation as OBSERVATION } from "@/generated/messages";
import type { TextKey, TextValues } from "@/i18n/text";
import { inNaturalUnit } from "./health";

/** The event list keeps this many events. */
export const MAX_EVENTS = 200;

export type EventKind = "lifecycle" | "phase" | "target" | "pause" | "estop" | "fault" | "observation" | "notice";

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

function seconds(stamp: { sec: number; nanosec: number }): number {
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
export function eventsBetween(before: lupin_msgs_MissionState | null, after: lupin_msgs_MissionState): MissionEvent[] {
  if (before === null) return [];
  const timeS = seconds(after.header.stamp);
  const events: MissionEvent[] = [];
  const changed = (field: keyof lupin_msgs_MissionState) => before[field] !== after[field];
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
      return { ...base, severity: "info", tag, text: { key: count === 1 ? "mission_event_read_one" : "mission_event_read", values: { tag, count } } };
    }
    const key = FAILURES[status] ?? "mission_event_scan_failed";
    return { ...base, severity: status === OBSERVATION.STATUS_SKIPPED ? "info" : "warn", tag, text: { key, values: { tag, detail } } };
  }
  if (kind === OBSERVATION.KIND_FLOWER) {
    const { tag_id: tag, flower_count: flowers, bug_count: bugs, anomaly } = observation.flower;
    const key = anomaly || bugs > 0 ? "mission_event_bug" : flowers === 1 ? "mission_event_flower" : "mission_event_flowers";
    return { ...base, severity: key === "mission_event_bug" ? "warn" : "info", tag, text: { key, values: { tag, flowers } } };
  }
  if (kind === OBSERVATION.KIND_ANOMALY) {
    return { ...base, severity: "warn", text: { raw: observation.anomaly.description } };
  }
  return null;
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
