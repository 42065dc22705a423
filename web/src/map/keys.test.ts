import { describe, expect, it } from "vitest";
import { commandOf } from "./keys";

const key = (name: string, changes = {}) => ({ key: name, shiftKey: false, ctrlKey: false, metaKey: false, altKey: false, ...changes });
const POSE = { x: 1, y: 2, yaw: 0 };

describe("keys of the map", () => {
  it("move the map, or the pose that is being drawn", () => {
    expect(commandOf(key("ArrowRight"), null, false)).toEqual({ do: "pan", x: -60, y: 0 });
    expect(commandOf(key("ArrowUp"), POSE, false)).toMatchObject({ do: "draft", pose: { x: 1, y: 2.1 } });
    expect(commandOf(key("ArrowUp", { shiftKey: true }), POSE, true)).toMatchObject({ pose: { y: 1.98 } });
  });

  it("turn and send only a pose that is there", () => {
    expect(commandOf(key("["), null, false)).toBeNull();
    expect(commandOf(key("Enter"), null, false)).toBeNull();
    expect(commandOf(key("Enter"), POSE, false)).toEqual({ do: "send" });
    expect(commandOf(key("]"), POSE, false)).toMatchObject({ do: "draft" });
  });

  it("leave the browser's own keys and the space bar alone", () => {
    expect(commandOf(key("+", { ctrlKey: true }), null, false)).toBeNull();
    expect(commandOf(key(" "), POSE, false)).toBeNull();
    expect(commandOf(key("Tab"), POSE, false)).toBeNull();
  });
});
