import { describe, expect, it } from "vitest";
import type { lupin_msgs_MissionState, lupin_msgs_Observation } from "@/generated/messages";
import { eventsBetween, observationEvent, observationKey, visitOf } from "./events";

const STATE = {
  header: { stamp: { sec: 12, nanosec: 500_000_000 }, frame_id: "" },
  lifecycle_state: "MONITORING",
  mission_phase: "NAVIGATING",
  current_target: "4",
  paused: false,
  estop_engaged: false,
  last_error: "",
  last_event: "",
  last_event_severity: 0,
} as lupin_msgs_MissionState;

const kinds = (changes: Partial<lupin_msgs_MissionState>) => eventsBetween(STATE, { ...STATE, ...changes }).map((event) => event.kind);

describe("events of the mission's state", () => {
  it("are none without a change, and none at first sight", () => {
    expect(kinds({})).toEqual([]);
    expect(eventsBetween(null, STATE)).toEqual([]);
    expect(eventsBetween(STATE, { ...STATE, lifecycle_state: "RETURNING" })).toEqual([
      { kind: "lifecycle", timeS: 12.5, severity: "info", text: { key: "mission_event_returning" } },
    ]);
  });

  it("have the kinds of the contract", () => {
    expect(kinds({ lifecycle_state: "RETURNING", mission_phase: "", current_target: "" })).toEqual(["lifecycle"]);
    expect(kinds({ lifecycle_state: "FAULT" })).toEqual(["fault"]);
    expect(kinds({ mission_phase: "SCANNING" })).toEqual(["phase"]);
    expect(kinds({ current_target: "7" })).toEqual(["target"]);
    expect(kinds({ paused: true, estop_engaged: true })).toEqual(["estop", "pause"]);
    expect(kinds({ last_error: "nav_status_6", last_event: "navigation retry", last_event_severity: 1 })).toEqual(["notice"]);
    expect(kinds({ last_error: "localization_failed", last_event: "localization failed", last_event_severity: 2 })).toEqual(["fault"]);
    expect(kinds({ last_error: "", last_event: "" })).toEqual([]);
  });

  it("keep states that the page does not know as they are called", () => {
    expect(eventsBetween(STATE, { ...STATE, lifecycle_state: "DANCING", mission_phase: "WALTZ" }).map((event) => event.text)).toEqual([
      { raw: "DANCING" },
      { raw: "WALTZ" },
    ]);
  });
});

const OBSERVATION = {
  header: { stamp: { sec: 30, nanosec: 0 }, frame_id: "map" },
  mission_id: "m1",
  source: "MonitoringMission",
  kind: 0,
  status: 0,
  status_detail: "",
  tag_reading: { tag_id: "4", readings: [{ name: "soil_moisture", value: 0.4 }] },
  flower: { tag_id: "4", flower_count: 2, bug_count: 0, anomaly: false },
  anomaly: { description: "water on the floor" },
} as unknown as lupin_msgs_Observation;

describe("events of observations", () => {
  it("say what was read, and why it was not", () => {
    expect(observationEvent(OBSERVATION)).toMatchObject({ tag: "4", severity: "info", text: { key: "mission_event_read" } });
    const failed = observationEvent({ ...OBSERVATION, status: 1, status_detail: "nav_timeout" });
    expect(failed).toMatchObject({ severity: "warn", text: { key: "mission_event_unreachable", values: { detail: "nav_timeout" } } });
    expect(observationEvent({ ...OBSERVATION, status: 99 })?.text).toMatchObject({ key: "mission_event_scan_failed" });
  });

  it("count flowers and warn of bugs", () => {
    expect(observationEvent({ ...OBSERVATION, kind: 1 })?.text).toMatchObject({ key: "mission_event_flowers" });
    const bug = observationEvent({ ...OBSERVATION, kind: 1, flower: { ...OBSERVATION.flower, bug_count: 1 } });
    expect(bug).toMatchObject({ severity: "warn", text: { key: "mission_event_bug" } });
  });

  it("pass over unknown kinds", () => {
    expect(observationEvent({ ...OBSERVATION, kind: 2 })?.text).toEqual({ raw: "water on the floor" });
    expect(observationEvent({ ...OBSERVATION, kind: 9 })).toBeNull();
  });

  it("become visits with natural units", () => {
    expect(visitOf(OBSERVATION)?.readings).toEqual([{ name: "soil_moisture", value: 40 }]);
    expect(visitOf({ ...OBSERVATION, kind: 1 })).toBeNull();
    expect(observationKey(OBSERVATION)).not.toBe(observationKey({ ...OBSERVATION, kind: 1 }));
  });
});
