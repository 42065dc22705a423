import { describe, expect, it } from "vitest";
import { deleteObstacle, loadObstacle } from "./saved_maps";

const MAP = { name: "hall", saved_s: 1, loadable: true, command: "lupin up --map /maps/hall.yaml" };
const FREE = { linkOpen: true, isViewer: false, isWatching: false, isHeldByOther: false, mission: { lifecycle_state: "READY" }, navigates: false };

describe("a saved map", () => {
  it("is loaded while nothing drives by the present one", () => {
    expect(loadObstacle(MAP, FREE)).toBeNull();
    expect(loadObstacle(MAP, { ...FREE, mission: null })).toBeNull();
    for (const lifecycle_state of ["PREPARE", "EXPLORING", "INSPECTING", "MONITORING", "RETURNING"]) {
      expect(loadObstacle(MAP, { ...FREE, mission: { lifecycle_state } })).toBe("mission_running");
    }
    expect(loadObstacle(MAP, { ...FREE, navigates: true })).toBe("map_goal_running");
    expect(loadObstacle({ ...MAP, loadable: false }, FREE)).toBe("map_not_loadable");
  });

  it("is deleted unless it is the loaded one, during a mission too", () => {
    expect(deleteObstacle(MAP, null, { ...FREE, mission: { lifecycle_state: "EXPLORING" }, navigates: true })).toBeNull();
    expect(deleteObstacle(MAP, "hall", FREE)).toBe("map_is_loaded");
  });

  it.each([
    [{ linkOpen: false }, "mission_no_link"],
    [{ isViewer: true }, "mission_viewer"],
    [{ isWatching: true }, "why_other_tab"],
    [{ isHeldByOther: true }, "mission_held"],
  ])("needs link, role and control: %o", (change, reason) => {
    expect(loadObstacle(MAP, { ...FREE, ...change })).toBe(reason);
    expect(deleteObstacle(MAP, null, { ...FREE, ...change })).toBe(reason);
  });
});
