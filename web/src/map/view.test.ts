import { describe, expect, it } from "vitest";
import { MAX_SCALE, type View, boundsOf, fit, grow, panBy, scaleBar, toScreen, toScreenAngle, toWorld, union, zoomAt } from "./view";

const SIZE = { width: 800, height: 600 };
const VIEW: View = { x: 2, y: 1, scale: 50, turned: false };

describe("the view from above", () => {
  it("shows its center in the middle, x to the right and y upwards", () => {
    expect(toScreen(VIEW, SIZE, { x: 2, y: 1 })).toEqual({ x: 400, y: 300 });
    expect(toScreen(VIEW, SIZE, { x: 3, y: 2 })).toEqual({ x: 450, y: 250 });
  });

  it.each([false, true])("finds the point of the map below a pixel, turned: %s", (turned) => {
    const view = { ...VIEW, turned };
    const point = toWorld(view, SIZE, { x: 123, y: 456 });
    expect(toScreen(view, SIZE, point).x).toBeCloseTo(123);
    expect(toScreen(view, SIZE, point).y).toBeCloseTo(456);
  });

  it("turns points and headings by 180 degrees together", () => {
    const turned = { ...VIEW, turned: true };
    expect(toScreen(turned, SIZE, { x: 3, y: 2 })).toEqual({ x: 350, y: 350 });
    expect(toScreenAngle(turned, 0)).toBeCloseTo(-Math.PI);
    expect(toScreenAngle(VIEW, Math.PI / 2)).toBeCloseTo(-Math.PI / 2);
  });

  it.each([false, true])("keeps the point below the pointer while it zooms, turned: %s", (turned) => {
    const view = { ...VIEW, turned };
    const pixel = { x: 700, y: 100 };
    const before = toWorld(view, SIZE, pixel);
    const after = toWorld(zoomAt(view, SIZE, pixel, 1.7), SIZE, pixel);
    expect(after.x).toBeCloseTo(before.x);
    expect(after.y).toBeCloseTo(before.y);
    expect(zoomAt(view, SIZE, pixel, 1e6).scale).toBe(MAX_SCALE);
  });

  it.each([false, true])("moves the map with the pointer, turned: %s", (turned) => {
    const view = { ...VIEW, turned };
    const before = toScreen(view, SIZE, { x: 0, y: 0 });
    const after = toScreen(panBy(view, { x: 30, y: -20 }), SIZE, { x: 0, y: 0 });
    expect(after.x - before.x).toBeCloseTo(30);
    expect(after.y - before.y).toBeCloseTo(-20);
  });

  it.each([false, true])("fits a rectangle between the margins, turned: %s", (turned) => {
    const bounds = { minX: -1, minY: -1, maxX: 7, maxY: 5 };
    const view = fit(bounds, SIZE, { top: 60, right: 20, bottom: 40, left: 20 }, turned);
    const corners = [toScreen(view, SIZE, { x: -1, y: -1 }), toScreen(view, SIZE, { x: 7, y: 5 })];
    expect(Math.min(...corners.map((corner) => corner.y))).toBeCloseTo(60);
    expect(Math.max(...corners.map((corner) => corner.y))).toBeCloseTo(560);
    expect(corners[0]!.x + corners[1]!.x).toBeCloseTo(800);
  });

  it("measures point sets without what is not finite", () => {
    expect(boundsOf([{ x: NaN, y: 0 }])).toBeNull();
    expect(boundsOf([{ x: 1, y: 2 }, { x: -1, y: 5 }])).toEqual({ minX: -1, minY: 2, maxX: 1, maxY: 5 });
    const one = { minX: 0, minY: 0, maxX: 1, maxY: 1 };
    expect(union(one, null)).toEqual(one);
    expect(union(null, one)).toEqual(one);
    expect(union(one, grow(one, 1))).toEqual({ minX: -1, minY: -1, maxX: 2, maxY: 2 });
  });

  it("chooses a round scale bar", () => {
    expect(scaleBar(70, 100)).toEqual({ meters: 1, pixels: 70 });
    expect(scaleBar(30, 100)).toEqual({ meters: 2, pixels: 60 });
    expect(scaleBar(300, 100).meters).toBeCloseTo(0.2);
  });
});
