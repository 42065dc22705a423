import { beforeEach, describe, expect, it } from "vitest";
import { Gestures } from "./gestures";

describe("gestures", () => {
  let seen: string[];
  let draws: boolean;
  let gestures: Gestures;
  const round = (value: number) => Math.round(value * 100) / 100;

  beforeEach(() => {
    seen = [];
    draws = false;
    gestures = new Gestures({
      draws: () => draws,
      pan: ({ x, y }) => seen.push(`pan ${x} ${y}`),
      zoom: (_, factor) => seen.push(`zoom ${round(factor)}`),
      tap: ({ x, y }) => seen.push(`tap ${x} ${y}`),
      draw: (start, end, phase) => seen.push(`draw ${start.x} ${end.x} ${phase}`),
      cancelDraw: () => seen.push("cancel"),
    });
  });

  it("move the map without losing the first pixels", () => {
    gestures.down(1, { x: 0, y: 0 }, true);
    gestures.move(1, { x: 3, y: 0 });
    gestures.move(1, { x: 8, y: 0 });
    gestures.move(1, { x: 9, y: 2 });
    gestures.up(1, { x: 9, y: 2 });
    expect(seen).toEqual(["pan 8 0", "pan 1 2"]);
  });

  it("choose by a tap", () => {
    gestures.down(1, { x: 5, y: 6 }, true);
    gestures.move(1, { x: 6, y: 6 });
    gestures.up(1, { x: 6, y: 6 });
    expect(seen).toEqual(["tap 6 6"]);
  });

  it("draw a pose with the tool, and move the map with the other button", () => {
    draws = true;
    gestures.down(1, { x: 0, y: 0 }, true);
    gestures.move(1, { x: 9, y: 0 });
    gestures.up(1, { x: 10, y: 0 });
    gestures.down(1, { x: 0, y: 0 }, false);
    gestures.move(1, { x: 9, y: 0 });
    expect(seen).toEqual(["draw 0 0 move", "draw 0 9 move", "draw 0 10 end", "pan 9 0"]);
  });

  it("zoom with two fingers, which end a drawing", () => {
    draws = true;
    gestures.down(1, { x: 0, y: 0 }, true);
    gestures.down(2, { x: 10, y: 0 }, true);
    gestures.move(2, { x: 20, y: 0 });
    gestures.up(2, { x: 20, y: 0 });
    gestures.up(1, { x: 0, y: 0 });
    expect(seen).toEqual(["draw 0 0 move", "cancel", "pan 5 0", "zoom 2"]);
  });

  it("zoom in where the wheel turns up, and end by themselves", () => {
    gestures.wheel({ x: 0, y: 0 }, -100);
    draws = true;
    gestures.down(1, { x: 0, y: 0 }, true);
    gestures.cancel();
    gestures.up(1, { x: 0, y: 0 });
    expect(seen).toEqual(["zoom 1.17", "draw 0 0 move", "cancel"]);
  });
});
