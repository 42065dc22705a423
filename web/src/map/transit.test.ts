import { describe, expect, it } from "vitest";
import type { Visit } from "./events";
import { type LineState, nearestOrder, transitStops } from "./transit";
import type { Tag } from "./twin";

const tag = (id: string, x: number | null = null) => ({ id, at: x === null ? null : { x, y: 0, z: 0 } }) as Tag;
const visit = (id: string, timeS: number, source = "MonitoringMission", status = 0): Visit => ({
  tag: id,
  missionId: "m1",
  source,
  status,
  timeS,
  readings: [],
});
const state = (changes: Partial<LineState>): LineState =>
  ({ mission_id: "m1", lifecycle_state: "MONITORING", current_target: "", targets_total: 4, visited: 0, ...changes });

const TAGS = [tag("1", 0), tag("2", 5), tag("3", 1), tag("4", 2)];
const line = (stops: ReturnType<typeof transitStops>) => stops.map((stop) => `${stop.tag}:${stop.state}`).join(" ");

describe("the transit line", () => {
  it("is empty without a mission", () => {
    expect(transitStops(null, [], TAGS)).toEqual([]);
    expect(transitStops(state({ mission_id: "" }), [], TAGS)).toEqual([]);
  });

  it("predicts the order of monitoring", () => {
    const visits = [visit("9", 1, "ExplorationMission"), visit("1", 10)];
    expect(line(transitStops(state({ current_target: "3" }), visits, TAGS))).toBe("1:done 3:current 4:next 2:open");
  });

  it("does not show a tag twice whose observation came before the next state", () => {
    expect(line(transitStops(state({ current_target: "1" }), [visit("1", 1)], TAGS))).toBe("1:current 3:next 4:open 2:open");
  });

  it("begins anew with every round", () => {
    const visits = ["1", "3", "4", "2", "1"].map((id, index) => visit(id, index));
    expect(line(transitStops(state({ current_target: "3" }), visits, TAGS))).toBe("1:done 3:current 4:next 2:open");
    expect(line(transitStops(state({ lifecycle_state: "DONE" }), visits.slice(0, 4), TAGS))).toBe("1:done 3:done 4:done 2:done");
  });

  it("shows what failed, and leaves out other missions", () => {
    const visits = [visit("1", 1, "InspectionMission", 1), visit("3", 2, "InspectionMission", 3), { ...visit("4", 3), missionId: "m0" }];
    const mission = state({ lifecycle_state: "INSPECTING", current_target: "4", targets_total: 4 });
    expect(line(transitStops(mission, visits, TAGS))).toBe("1:failed 3:skipped 4:current 2:next");
    expect(line(transitStops(mission, visits, TAGS, ["1", "3", "4", "3"]))).toBe("1:failed 3:skipped 4:current 3:next");
    expect(line(transitStops({ ...mission, targets_total: 6 }, visits, TAGS))).toBe("1:failed 3:skipped 4:current :open :open :open");
  });

  it("has stops without a name for visits that this page did not see", () => {
    const inspection = state({ lifecycle_state: "INSPECTING", current_target: "4", visited: 2, targets_total: 3 });
    expect(line(transitStops(inspection, [visit("1", 1, "InspectionMission")], TAGS))).toBe(":done 1:done 4:current");
    const second = state({ current_target: "3", visited: 6 });
    expect(line(transitStops(second, [visit("1", 1)], TAGS))).toBe(":done 1:done 3:current 4:next 2:open");
    expect(line(transitStops(state({ visited: NaN, targets_total: NaN }), [], TAGS)).startsWith("1:")).toBe(true);
  });

  it("shows the tags found while exploring, without an order", () => {
    const mission = state({ lifecycle_state: "EXPLORING", targets_total: 2 });
    expect(line(transitStops(mission, [visit("3", 1, "ExplorationMission")], TAGS))).toBe("3:done 1:open 2:open 4:open");
  });

  it("puts tags without a place last", () => {
    expect(nearestOrder([tag("7"), ...TAGS], new Set(["1"]), "1")).toEqual(["3", "4", "2", "7"]);
    expect(nearestOrder(TAGS, new Set(), "unknown")).toEqual(["1", "2", "3", "4"]);
  });
});
