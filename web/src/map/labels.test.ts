import { describe, expect, it } from "vitest";
import { type Label, overlaps, placeLabels } from "./labels";

function label(id: string, x: number, y: number, changes: Partial<Label> = {}): Label {
  return { id, x, y, width: 50, height: 24, direction: 0, priority: 0, ...changes };
}

describe("labels", () => {
  it("lie in their direction where there is room", () => {
    const place = placeLabels([label("1", 100, 100)]).get("1")!;
    expect(place.x).toBeCloseTo(112);
    expect(place.y).toBeCloseTo(88);
    const above = placeLabels([label("1", 100, 100, { direction: -Math.PI / 2 })]).get("1")!;
    expect(above.y + above.height).toBeCloseTo(88);
  });

  it("make room for each other and for obstacles", () => {
    const labels = Array.from({ length: 6 }, (_, index) => label(String(index), 100 + index * 15, 100));
    const obstacle = { x: 110, y: 90, width: 30, height: 20 };
    const rectangles = [...placeLabels(labels, [obstacle]).values(), obstacle];
    rectangles.forEach((one, index) => {
      for (const other of rectangles.slice(index + 1)) expect(overlaps(one, other, 0)).toBe(false);
    });
  });

  it("give the best place to the most important one", () => {
    const place = placeLabels([label("1", 100, 100), label("2", 100, 100, { priority: 1 })]);
    expect(place.get("2")?.x).toBeCloseTo(112);
    expect(place.get("1")?.x).not.toBeCloseTo(112);
  });

  it("overlap when there is no room at all", () => {
    const everywhere = { x: -1000, y: -1000, width: 3000, height: 3000 };
    expect(placeLabels([label("1", 0, 0)], [everywhere]).size).toBe(1);
  });
});
