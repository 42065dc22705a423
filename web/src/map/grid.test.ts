import { describe, expect, it } from "vitest";
import { ENCLOSED, FLOOR, OUTSIDE, type Palette, VAGUE, WALLED, classify, isSameGrid, knownBounds, paint, readGrid } from "./grid";
import { gridMessage } from "./grid_fixture";

const ROOM = gridMessage(["?????", "?###?", "?#?#?", "?###?", "?..~?"]);
const PALETTE: Palette = {
  [OUTSIDE]: [0, 0, 0, 0],
  [FLOOR]: [1, 1, 1, 255],
  [VAGUE]: [2, 2, 2, 255],
  [WALLED]: [3, 3, 3, 255],
  [ENCLOSED]: [4, 4, 4, 255],
};

describe("the occupancy grid", () => {
  it("tells what is enclosed from what is outside", () => {
    const grid = readGrid(ROOM)!;
    const kinds = classify(grid);
    expect([...kinds.subarray(0, 5)]).toEqual([OUTSIDE, FLOOR, FLOOR, VAGUE, OUTSIDE]);
    expect([...kinds.subarray(10, 15)]).toEqual([OUTSIDE, WALLED, ENCLOSED, WALLED, OUTSIDE]);
    expect([...kinds.subarray(20)]).toEqual(Array(5).fill(OUTSIDE));
  });

  it("takes gaps between rays for unknown, not for enclosed", () => {
    const grid = readGrid(gridMessage([".....", ".?.?.", "....."]))!;
    expect([...classify(grid)].filter((kind) => kind !== FLOOR)).toEqual([OUTSIDE, OUTSIDE]);
  });

  it("is painted with its first row at the bottom", () => {
    const grid = readGrid(ROOM)!;
    const pixels = paint(grid, classify(grid), PALETTE);
    const pixel = (column: number, row: number) => [...pixels.subarray((row * 5 + column) * 4, (row * 5 + column) * 4 + 4)];
    expect(pixel(1, 4)).toEqual([1, 1, 1, 255]);
    expect(pixel(2, 2)).toEqual([4, 4, 4, 255]);
    expect(pixel(0, 0)).toEqual([0, 0, 0, 0]);
  });

  it("knows the rectangle of what is known", () => {
    const grid = readGrid(ROOM)!;
    expect(knownBounds(grid, classify(grid))).toEqual({ minX: 1.5, minY: 2, maxX: 3, maxY: 4 });
    const empty = readGrid(gridMessage(["??", "??"]))!;
    expect(knownBounds(empty, classify(empty))).toBeNull();
  });

  it("follows the direction of its rows", () => {
    const grid = readGrid(gridMessage(["..", ".."], 0.5, Math.PI / 2))!;
    const bounds = knownBounds(grid, classify(grid))!;
    expect(bounds.minX).toBeCloseTo(0);
    expect(bounds.maxX).toBeCloseTo(1);
    expect(bounds.minY).toBeCloseTo(2);
  });

  it("passes over empty and contradictory messages", () => {
    expect(readGrid(gridMessage([]))).toBeNull();
    expect(readGrid({ ...ROOM, data: new Int8Array(3) })).toBeNull();
    expect(readGrid({ ...ROOM, info: { ...ROOM.info, resolution: NaN } })).toBeNull();
    expect(readGrid({ ...ROOM, info: { ...ROOM.info, width: 1e6, height: 1e6 } })).toBeNull();
  });

  it("notices growth and change", () => {
    const grid = readGrid(ROOM)!;
    expect(isSameGrid(null, grid)).toBe(false);
    expect(isSameGrid(grid, readGrid(ROOM)!)).toBe(true);
    expect(isSameGrid(grid, readGrid(gridMessage([...["......"], "......"]))!)).toBe(false);
    const changed = { ...grid, cells: grid.cells.with(3, 100) };
    expect(isSameGrid(grid, changed)).toBe(false);
  });
});
