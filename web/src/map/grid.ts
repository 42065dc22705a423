/** The occupancy grid as a picture: free floor, walls, and what lies enclosed between walls. */
import type { nav_msgs_OccupancyGrid } from "@/generated/messages";
import { yawOf } from "@/ros/tf";
import { type Bounds, type Point, boundsOf } from "./view";

/** Occupancy in percent from which a cell counts as a wall, and up to which it counts as free, as in map_server. */
const WALL = 65;
const FREE = 25;
/** More cells than any greenhouse has; the message is passed over. */
const MAX_CELLS = 16_000_000;

export interface Grid {
  width: number;
  height: number;
  resolutionM: number;
  /** The corner of cell (0, 0), and the direction of the rows. */
  origin: { x: number; y: number; yaw: number };
  /** Row by row from the origin; -1 unknown, 0..100 occupied. */
  cells: Int8Array;
}

export type CellKind = 0 | 1 | 2 | 3 | 4;
export const OUTSIDE = 0;
export const FLOOR = 1;
export const VAGUE = 2;
export const WALLED = 3;
/** Unknown, with no way to the edge of the grid and mostly walls around: the inside of a table or a wall. */
export const ENCLOSED = 4;

/** The grid of a message; null where it is empty or its numbers contradict each other. */
export function readGrid(message: nav_msgs_OccupancyGrid): Grid | null {
  const { width, height, resolution, origin } = message.info;
  const yaw = yawOf(origin.orientation);
  const cells = message.data;
  const isFinite = [resolution, origin.position.x, origin.position.y].every(Number.isFinite);
  if (!(width > 0 && height > 0 && width * height <= MAX_CELLS && resolution > 0 && isFinite)) return null;
  if (cells.length !== width * height) return null;
  const grid = { width, height, resolutionM: resolution, cells: cells instanceof Int8Array ? cells : Int8Array.from(cells) };
  return { ...grid, origin: { x: origin.position.x, y: origin.position.y, yaw: Number.isFinite(yaw) ? yaw : 0 } };
}

export function isSameGrid(first: Grid | null, second: Grid): boolean {
  if (first === null || first.width !== second.width || first.height !== second.height) return false;
  if (first.resolutionM !== second.resolutionM) return false;
  if (first.origin.x !== second.origin.x || first.origin.y !== second.origin.y || first.origin.yaw !== second.origin.yaw) return false;
  return first.cells.every((value, index) => value === second.cells[index]);
}

/** What each cell shows. */
export function classify(grid: Grid): Uint8Array {
  const { width, height, cells } = grid;
  const kinds = new Uint8Array(width * height);
  for (let index = 0; index < kinds.length; index += 1) {
    const value = cells[index] ?? -1;
    kinds[index] = value < 0 || value > 100 ? ENCLOSED : value >= WALL ? WALLED : value <= FREE ? FLOOR : VAGUE;
  }
  markOutside(kinds, width, height);
  openHoles(kinds, width, height);
  return kinds;
}

/** Gaps between the rays of a lidar are unknown as well, but nothing that walls enclose: they become outside. */
function openHoles(kinds: Uint8Array, width: number, height: number): void {
  const visited = new Uint8Array(kinds.length);
  for (let start = 0; start < kinds.length; start += 1) {
    if (kinds[start] !== ENCLOSED || visited[start] === 1) continue;
    const cells = [start];
    visited[start] = 1;
    let [walls, open] = [0, 0];
    const look = (neighbor: number) => {
      const kind = kinds[neighbor];
      if (kind === WALLED) walls += 1;
      else if (kind !== ENCLOSED) open += 1;
      else if (visited[neighbor] === 0) {
        visited[neighbor] = 1;
        cells.push(neighbor);
      }
    };
    for (let next = 0; next < cells.length; next += 1) visitNeighbors(cells[next] ?? 0, width, height, look);
    if (walls <= open) for (const cell of cells) kinds[cell] = OUTSIDE;
  }
}

function visitNeighbors(index: number, width: number, height: number, visit: (neighbor: number) => void): void {
  const x = index % width;
  if (x > 0) visit(index - 1);
  if (x < width - 1) visit(index + 1);
  if (index >= width) visit(index - width);
  if (index < (height - 1) * width) visit(index + width);
}

/** Unknown cells with a way through unknown cells to the edge of the grid are outside. */
function markOutside(kinds: Uint8Array, width: number, height: number): void {
  const stack: number[] = [];
  const visit = (index: number) => {
    if (kinds[index] !== ENCLOSED) return;
    kinds[index] = OUTSIDE;
    stack.push(index);
  };
  for (let x = 0; x < width; x += 1) {
    visit(x);
    visit((height - 1) * width + x);
  }
  for (let y = 0; y < height; y += 1) {
    visit(y * width);
    visit(y * width + width - 1);
  }
  for (let index = stack.pop(); index !== undefined; index = stack.pop()) visitNeighbors(index, width, height, visit);
}

/** An opaque or transparent color of each kind of cell, as red, green, blue, alpha 0..255. */
export type Palette = Record<CellKind, readonly [number, number, number, number]>;

/** The pixels of the picture, whose first row is the grid's last: the y axis of pictures points down. */
export function paint(grid: Grid, kinds: Uint8Array, palette: Palette): Uint8ClampedArray<ArrayBuffer> {
  const { width, height } = grid;
  const pixels = new Uint8ClampedArray(width * height * 4);
  for (let row = 0; row < height; row += 1) {
    const from = (height - 1 - row) * width;
    for (let column = 0; column < width; column += 1) {
      pixels.set(palette[(kinds[from + column] ?? OUTSIDE) as CellKind], (row * width + column) * 4);
    }
  }
  return pixels;
}

/** A point of the map, from its place in the grid in cells. */
export function fromCells(grid: Grid, column: number, row: number): Point {
  const cos = Math.cos(grid.origin.yaw) * grid.resolutionM;
  const sin = Math.sin(grid.origin.yaw) * grid.resolutionM;
  return { x: grid.origin.x + cos * column - sin * row, y: grid.origin.y + sin * column + cos * row };
}

/** The rectangle of the map around everything that is known; null while nothing is. */
export function knownBounds(grid: Grid, kinds: Uint8Array): Bounds | null {
  let [minX, minY, maxX, maxY] = [Infinity, Infinity, -Infinity, -Infinity];
  for (let row = 0; row < grid.height; row += 1) {
    for (let column = 0; column < grid.width; column += 1) {
      if (kinds[row * grid.width + column] === OUTSIDE) continue;
      if (column < minX) minX = column;
      if (column >= maxX) maxX = column + 1;
      if (row < minY) minY = row;
      maxY = row + 1;
    }
  }
  if (maxX < 0) return null;
  return boundsOf([fromCells(grid, minX, minY), fromCells(grid, maxX, minY), fromCells(grid, minX, maxY), fromCells(grid, maxX, maxY)]);
}
