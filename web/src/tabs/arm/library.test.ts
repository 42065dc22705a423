import { describe, expect, it } from "vitest";
import { isArmBusy, parseLibrary, parseLibraryState, storedName } from "./library";

describe("the library", () => {
  it("is read from its JSON", () => {
    const json = JSON.stringify({
      poses: [{ name: "look_left", note: "at the door", has_gripper: true }, { note: "without a name" }, 7],
      sequences: [{ name: "wave", mode: "teleop", duration_s: 4.5, n_waypoints: 90, include_gripper: false }],
    });
    expect(parseLibrary(json)).toEqual({
      poses: [{ name: "look_left", note: "at the door", hasGripper: true }],
      sequences: [{ name: "wave", mode: "teleop", durationS: 4.5, waypoints: 90, hasGripper: false }],
    });
  });

  it.each(["", "{", "null", "[]", "7"])("is unknown in %s", (json) => {
    expect(parseLibrary(json)).toBeNull();
    expect(parseLibraryState(json)).toBeNull();
  });

  it("survives wrong types", () => {
    expect(parseLibrary('{"poses": {}, "sequences": [{"name": 1}]}')).toEqual({ poses: [], sequences: [] });
    expect(parseLibraryState('{"progress": 7, "elapsed_s": "x", "torque": null}')).toMatchObject({ progress: 1, elapsedS: 0, torque: true });
  });
});

describe("the sliders", () => {
  const state = (fields: object) => parseLibraryState(JSON.stringify(fields));

  it("are frozen by a replay and while the arm is led by hand", () => {
    expect(isArmBusy(state({ playing: true }))).toBe(true);
    expect(isArmBusy(state({ recording: true, mode: "kinesthetic" }))).toBe(true);
    expect(isArmBusy(state({}))).toBe(false);
    expect(isArmBusy(null)).toBe(false);
  });

  it("are what a recording in teleop mode records", () => {
    expect(isArmBusy(state({ recording: true, mode: "teleop" }))).toBe(false);
  });
});

describe("a name", () => {
  it("is stored trimmed and in lower case", () => {
    expect(storedName("  Look_Left-2 ")).toBe("look_left-2");
  });

  it.each(["", "  ", "_x", "a b", "é", "a".repeat(33), "<b>"])("like %j is refused", (name) => {
    expect(storedName(name)).toBeNull();
  });
});
