import { describe, expect, it } from "vitest";
import { ENCLOSED, WALLED, classify, readGrid } from "./grid";
import { gridMessage } from "./grid_fixture";
import { type Mesh, coverWithRectangles, sidesOf, topsOf } from "./wall_mesh";

/** The area of all triangles by the direction of their normals, and whether all wind counter-clockwise around them. */
function measure(mesh: Mesh): { areas: Record<string, number>; consistent: boolean } {
  const areas: Record<string, number> = {};
  let consistent = true;
  const corner = (index: number) => [0, 1, 2].map((axis) => mesh.positions[index * 3 + axis]!) as [number, number, number];
  for (let start = 0; start < mesh.indices.length; start += 3) {
    const [a, b, c] = [0, 1, 2].map((offset) => corner(mesh.indices[start + offset]!)) as unknown as [number[], number[], number[]];
    const u = b.map((value, axis) => value - a[axis]!);
    const v = c.map((value, axis) => value - a[axis]!);
    const cross = [u[1]! * v[2]! - u[2]! * v[1]!, u[2]! * v[0]! - u[0]! * v[2]!, u[0]! * v[1]! - u[1]! * v[0]!];
    const normal = [0, 1, 2].map((axis) => mesh.normals[mesh.indices[start]! * 3 + axis]!);
    const name = normal.map((value) => Math.round(value)).join();
    areas[name] = (areas[name] ?? 0) + Math.hypot(...cross) / 2;
    consistent &&= cross.reduce((sum, value, axis) => sum + value * normal[axis]!, 0) > 0;
  }
  return { areas, consistent };
}

describe("walls", () => {
  it("are covered by few rectangles", () => {
    const cells = ["##.", "##.", "..#"];
    const found = coverWithRectangles((column, row) => cells[row]?.[column] === "#", 3, 3);
    expect(found).toEqual([
      { column: 0, row: 0, width: 2, height: 2 },
      { column: 2, row: 2, width: 1, height: 1 },
    ]);
  });

  it.each([0, 1])("have a top and outer sides only, rows turned by %s rad", (yaw) => {
    const grid = readGrid(gridMessage([".....", ".###.", ".#?#.", ".###.", "....."], 0.5, yaw))!;
    const kinds = classify(grid);
    const tops = measure(topsOf(grid, kinds, [WALLED, ENCLOSED], 0.3));
    const sides = measure(sidesOf(grid, kinds, [WALLED, ENCLOSED], 0.3));
    expect(tops.consistent && sides.consistent).toBe(true);
    expect(tops.areas).toEqual({ "0,0,1": expect.closeTo(2.25) as number });
    expect(Object.values(sides.areas).reduce((sum, area) => sum + area, 0)).toBeCloseTo(4 * 1.5 * 0.3);
  });

  it("are nothing on an empty floor", () => {
    const grid = readGrid(gridMessage(["..", ".."]))!;
    expect(topsOf(grid, classify(grid), [WALLED], 0.3).indices.length).toBe(0);
    expect(sidesOf(grid, classify(grid), [WALLED], 0.3).indices.length).toBe(0);
  });
});
