import { describe, expect, it } from "vitest";
import type { lupin_msgs_GetField_Response } from "@/generated/messages";
import { classify, readGrid } from "./grid";
import { gridMessage } from "./grid_fixture";
import { heatColor, paintField, readField, share, valueAt } from "./heat";

function answer(values: (number | null)[], width: number): lupin_msgs_GetField_Response {
  return {
    ok: true,
    error_message: "",
    // As JSON gives it.
    values: values as unknown as Float32Array,
    width,
    height: values.length / width,
    origin_x: 1,
    origin_y: 2,
    resolution_used: 0.5,
    value_min: 0,
    value_max: 0,
    sample_count: 2,
  };
}

describe("heat maps", () => {
  it("read answers whose NaN became null, in natural units", () => {
    const field = readField("soil_moisture", answer([0.2, null, 0.5, null], 2))!;
    expect(field.values[1]).toBeNaN();
    expect(field.range?.low).toBeCloseTo(20);
    expect(field.range?.high).toBeCloseTo(50);
  });

  it("pass over refused and contradictory answers", () => {
    expect(readField("light", { ...answer([1], 1), ok: false })).toBeNull();
    expect(readField("light", { ...answer([1, 2], 2), width: 3 })).toBeNull();
    expect(readField("light", { ...answer([], 1), width: 0, height: 0 })).toBeNull();
    expect(readField("light", answer([null], 1))?.range).toBeNull();
  });

  it("have the contract's colors, but can be seen at their lowest value", () => {
    expect(share(5, { low: 5, high: 5 })).toBe(1);
    const [red, green, blue, alpha] = heatColor("temperature", 0);
    // hsl(30 70% 80%)
    expect([red, green, blue]).toEqual([240, 204, 168]);
    expect(alpha).toBe(0.3);
    expect(heatColor("light", 1)[3]).toBe(0.6);
  });

  it("know values only where cells were measured", () => {
    const field = readField("light", answer([10, 20, null, null], 2))!;
    expect(valueAt(field, 1.25, 2.25)).toBe(10);
    expect(valueAt(field, 1.5, 2.25)).toBe(15);
    expect(valueAt(field, 1.25, 2.75)).toBeNaN();
    expect(valueAt(field, 99, 99)).toBeNaN();
    expect(valueAt(field, 1.02, 2.02)).toBeNaN();
  });

  it("are painted on the measured floor only", () => {
    const grid = readGrid(gridMessage(["..", "#."]))!;
    const pixels = paintField(readField("light", answer([10, 20, null, 30], 2))!, grid, classify(grid));
    const alpha = (column: number, row: number) => pixels[(row * 2 + column) * 4 + 3];
    expect(alpha(0, 1)).toBe(0);
    expect(alpha(1, 1)).toBeGreaterThanOrEqual(76);
    expect(alpha(0, 0)).toBe(0);
    expect(alpha(1, 0)).toBe(153);
  });
});
