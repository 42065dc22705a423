// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import type { PastState } from "@/api/history";
import { consoleEvent } from "./events";
import { type LoggedEvent, StateEvents, collapseEvents } from "./mission_log";

const state = (sec: number, paused: boolean): PastState => ({
  header: { stamp: { sec, nanosec: 0 } },
  lifecycle_state: "MONITORING",
  mission_phase: "",
  current_target: "",
  last_error: "",
  last_event: "",
  last_event_severity: 0,
  estop_engaged: false,
  paused,
});

describe("the mission's states of the past and of now", () => {
  it("make each event once at the seam", () => {
    const states = new StateEvents();
    const past = [state(1, false), state(2, true), state(3, false)];
    expect(past.flatMap((each) => states.takePast(each)).map(({ timeS }) => timeS)).toEqual([2, 3]);
    expect(states.take(state(3, false))).toEqual([]);
    expect(states.take(state(4, true)).map(({ timeS }) => timeS)).toEqual([4]);
    expect(past.flatMap((each) => states.takePast(each)), "asked for again after an outage").toEqual([]);
    expect(states.takePast(state(5, false)).map(({ timeS }) => timeS)).toEqual([5]);
  });
});

describe("an event of the console", () => {
  const event = (kind: string) => consoleEvent({ number: 1, robot_s: 7.5, kind, name: "phone-1", other: "laptop-1" });

  it("tells a stop as a warning, and its end as news", () => {
    expect(event("stop_silent")).toEqual({ kind: "estop", timeS: 7.5, severity: "warn", text: { key: "mission_event_stop_not_back", values: { name: "phone-1", other: "laptop-1" } } });
    expect(event("stop_released")).toMatchObject({ kind: "estop", severity: "info" });
    expect(event("control_expired")).toMatchObject({ kind: "control", severity: "info" });
  });

  it("of a newer server is shown in its words", () => {
    expect(event("control_new").text).toEqual({ raw: "control_new phone-1 laptop-1" });
  });
});

const logged = (number: number, flowers: number): LoggedEvent => ({
  number,
  kind: "observation",
  timeS: number,
  severity: "info",
  text: { key: "mission_event_flowers", values: { tag: "4", flowers } },
});

describe("events in a row", () => {
  it("that say the same are one with a count", () => {
    const rows = collapseEvents([logged(5, 2), logged(4, 3), logged(3, 3), logged(2, 3), logged(1, 2)]);
    expect(rows.map(({ event: { number }, count }) => [number, count])).toEqual([[5, 1], [4, 3], [1, 1]]);
  });
});
