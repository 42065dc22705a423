// @vitest-environment jsdom
import { afterEach, describe, expect, it } from "vitest";
import { SERVICES, TOPICS } from "@/generated/graph";
import { CommandRefused, refuseCommand, refuseRequest } from "./guard";
import { useTabRole } from "@/safety/commanding_tab";
import { goElsewhere } from "@/safety/elsewhere";
import { LIVE, useRewind } from "@/state/rewind";

afterEach(() => {
  useRewind.setState(LIVE);
  useTabRole.setState({ role: "unknown" });
  goElsewhere(null);
});

describe("a page that shows the past", () => {
  it("sends no command", () => {
    useRewind.setState({ shownS: 12 });
    for (const row of [TOPICS.CMD_VEL_MANUAL, TOPICS.GOAL_POSE, SERVICES.MISSION_START, SERVICES.ARM_PRESET, { console: undefined as never }]) {
      expect(() => refuseCommand(row)).toThrow(CommandRefused);
    }
    const refused: [string, unknown][] = [
      ["/_api/stop", { engaged: false }],
      ["/_api/lease", { action: "take" }],
      ["/_api/lease", { action: "take_over", from: "x" }],
      ["/_api/maps/load", { name: "hall" }],
      ["/_api/doctor/fix", { finding: "x", confirmed: true }],
      ["/_api/locations", null],
      ["/_api/settings", {}],
    ];
    for (const [path, body] of refused) expect(() => refuseRequest(path, body)).toThrow(CommandRefused);
  });

  it("stops, answers who asks for control, and reads", () => {
    useRewind.setState({ shownS: 12 });
    expect(() => refuseRequest("/_api/stop", { engaged: true })).not.toThrow();
    for (const action of ["grant", "refuse", "give_up"]) expect(() => refuseRequest("/_api/lease", { action })).not.toThrow();
    expect(() => refuseCommand(SERVICES.GET_TIME)).not.toThrow();
    expect(() => refuseCommand(SERVICES.GET_FIELD)).not.toThrow();
  });
});

it("a tab that watches another one stops and commands nothing", () => {
  useTabRole.setState({ role: "watching" });
  expect(() => refuseCommand(TOPICS.GOAL_POSE)).toThrow("other_tab_no_command");
  expect(() => refuseRequest("/_api/lease", { action: "take" })).toThrow("other_tab_no_command");
  expect(() => refuseRequest("/_api/stop", { engaged: true })).not.toThrow();
});

it("a page that shows another robot than its console's stops, takes that back, and commands nothing", async () => {
  const { gate } = await import("@/robot/stop");
  goElsewhere("ws://192.0.2.7:9090");
  expect(() => refuseCommand(TOPICS.GOAL_POSE)).toThrow("elsewhere_no_command");
  expect(() => refuseCommand(SERVICES.GET_TIME)).not.toThrow();
  for (const [path, body] of [
    ["/_api/lease", { action: "take" }],
    ["/_api/stop", { engaged: false }],
    ["/_api/stop", { engaged: false, presses: [gate.press] }],
    ["/_api/stop", { engaged: false, press: "press:phone" }],
  ] as const) {
    expect(() => refuseRequest(path, body)).toThrow("elsewhere_no_command");
  }
  expect(() => refuseRequest("/_api/stop", { engaged: true })).not.toThrow();
  expect(() => refuseRequest("/_api/stop", { engaged: false, press: gate.press })).not.toThrow();
});

it("a live page sends everything", () => {
  expect(() => refuseCommand(TOPICS.GOAL_POSE)).not.toThrow();
  expect(() => refuseRequest("/_api/lease", { action: "take" })).not.toThrow();
});
