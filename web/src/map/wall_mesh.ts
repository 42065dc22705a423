/** The walls of the grid as a solid: few rectangles above, and sides only where a wall ends. */
import { type Grid, fromCells } from "./grid";

export interface Mesh {
  /** x, y, z of each corner in the map, m. */
  positions: Float32Array;
  normals: Float32Array;
  /** Three corners of each triangle. */
  indices: Uint32Array;
}

/** A rectangle of cells. */
interface CellRectangle {
  column: number;
  row: number;
  width: number;
  height: number;
}

/** Cover the marked cells with rectangles, each as wide as it gets and then as high. */
export function coverWithRectangles(marked: Marked, width: number, height: number): CellRectangle[] {
  const taken = new Uint8Array(width * height);
  const free = (column: number, row: number) => taken[row * width + column] === 0 && marked(column, row);
  const found: CellRectangle[] = [];
  for (let row = 0; row < height; row += 1) {
    for (let column = 0; column < width; column += 1) {
      if (!free(column, row)) continue;
      let wide = 1;
      while (column + wide < width && free(column + wide, row)) wide += 1;
      let high = 1;
      const isFreeRow = (at: number) => {
        for (let step = 0; step < wide; step += 1) if (!free(column + step, at)) return false;
        return true;
      };
      while (row + high < height && isFreeRow(row + high)) high += 1;
      for (let y = row; y < row + high; y += 1) taken.fill(1, y * width + column, y * width + column + wide);
      found.push({ column, row, width: wide, height: high });
    }
  }
  return found;
}

type Marked = (column: number, row: number) => boolean;

function markedCells(grid: Grid, kinds: Uint8Array, wanted: readonly number[]): Marked {
  const { width, height } = grid;
  return (column, row) =>
    column >= 0 && row >= 0 && column < width && row < height && wanted.includes(kinds[row * width + column] ?? -1);
}

/** The cells of some kinds as level surfaces at `heightM`. */
export function topsOf(grid: Grid, kinds: Uint8Array, wanted: readonly number[], heightM: number): Mesh {
  const builder = new MeshBuilder(grid);
  for (const { column, row, width, height } of coverWithRectangles(markedCells(grid, kinds, wanted), grid.width, grid.height)) {
    builder.addQuad(
      [column, row, heightM],
      [column + width, row, heightM],
      [column + width, row + height, heightM],
      [column, row + height, heightM],
      [0, 0, 1],
    );
  }
  return builder.mesh();
}

/** The upright sides from the floor to `heightM` where cells of some kinds end. */
export function sidesOf(grid: Grid, kinds: Uint8Array, wanted: readonly number[], heightM: number): Mesh {
  const builder = new MeshBuilder(grid);
  const cos = Math.cos(grid.origin.yaw);
  const sin = Math.sin(grid.origin.yaw);
  for (const { from, to, outward } of wallEdges(markedCells(grid, kinds, wanted), grid.width, grid.height)) {
    builder.addQuad([...from, 0], [...to, 0], [...to, heightM], [...from, heightM], [
      cos * outward[0] - sin * outward[1],
      sin * outward[0] + cos * outward[1],
      0,
    ]);
  }
  return builder.mesh();
}

interface Edge {
  from: [number, number];
  to: [number, number];
  outward: [number, number];
}

/** The edges between marked and other cells, as long as they run straight; the solid lies to their left. */
function wallEdges(marked: Marked, width: number, height: number): Edge[] {
  const edges: Edge[] = [];
  for (let row = 0; row < height; row += 1) {
    runs(width, (column) => marked(column, row) && !marked(column, row - 1), (start, end) =>
      edges.push({ from: [start, row], to: [end, row], outward: [0, -1] }),
    );
    runs(width, (column) => marked(column, row) && !marked(column, row + 1), (start, end) =>
      edges.push({ from: [end, row + 1], to: [start, row + 1], outward: [0, 1] }),
    );
  }
  for (let column = 0; column < width; column += 1) {
    runs(height, (row) => marked(column, row) && !marked(column - 1, row), (start, end) =>
      edges.push({ from: [column, end], to: [column, start], outward: [-1, 0] }),
    );
    runs(height, (row) => marked(column, row) && !marked(column + 1, row), (start, end) =>
      edges.push({ from: [column + 1, start], to: [column + 1, end], outward: [1, 0] }),
    );
  }
  return edges;
}

function runs(length: number, holds: (index: number) => boolean, found: (start: number, end: number) => void): void {
  let start = -1;
  for (let index = 0; index <= length; index += 1) {
    const held = index < length && holds(index);
    if (held && start < 0) start = index;
    if (!held && start >= 0) {
      found(start, index);
      start = -1;
    }
  }
}

type Corner = readonly [column: number, row: number, z: number];

class MeshBuilder {
  private positions: number[] = [];
  private normals: number[] = [];
  private indices: number[] = [];

  constructor(private readonly grid: Grid) {}

  /** Add four corners, counter-clockwise as seen from where the normal points. */
  addQuad(a: Corner, b: Corner, c: Corner, d: Corner, normal: readonly [number, number, number]): void {
    const first = this.positions.length / 3;
    for (const [column, row, z] of [a, b, c, d]) {
      const { x, y } = fromCells(this.grid, column, row);
      this.positions.push(x, y, z);
      this.normals.push(...normal);
    }
    this.indices.push(first, first + 1, first + 2, first, first + 2, first + 3);
  }

  mesh(): Mesh {
    return {
      positions: Float32Array.from(this.positions),
      normals: Float32Array.from(this.normals),
      indices: Uint32Array.from(this.indices),
    };
  }
}
