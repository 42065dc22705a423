/** The mock greenhouse: a room with three rows of tables, and eight tags with their flowers. */
import type { Pose2 } from "@/ros/tf";

export const RESOLUTION_M = 0.05;
export const WIDTH_CELLS = 200;
export const HEIGHT_CELLS = 160;
export const ORIGIN = { x: -5, y: -4 };
export const WALL_HEIGHT_M = 1.1;
export const TABLE_HEIGHT_M = 0.42;
export const TAG_EDGE_M = 0.1;
export const TAG_HEIGHT_M = 0.24;

interface Box {
  left: number;
  right: number;
  bottom: number;
  top: number;
}

/** The room's inside, m. */
export const ROOM: Box = { left: -4.2, right: 4.2, bottom: -2.8, top: 2.8 };
const WALL_M = 0.1;

export const TABLES: readonly Box[] = [
  { left: -3.1, right: 3.1, bottom: 1.45, top: 1.95 },
  { left: -2.2, right: -0.9, bottom: -0.2, top: 0.2 },
  { left: 0.9, right: 2.2, bottom: -0.2, top: 0.2 },
  { left: -3.1, right: 3.1, bottom: -1.95, top: -1.45 },
];

export interface Tag {
  id: string;
  /** The tag's pose: on the front of its table, facing away from it. */
  pose: Pose2;
  species: string;
  flowers: number;
  bugs: number;
  readings: Readonly<Record<string, number>>;
  /** Age of its last reading when the page was opened, s. */
  ageS: number;
}

const DOWN = -Math.PI / 2;
const UP = Math.PI / 2;

/** In the order in which two missions visit them: the right half, then the left one. */
export const TAGS: readonly Tag[] = [
  tag("19", 1.83, 1.45, DOWN, "tulip_red", 1, 0, { co2: 412, light: 776 }, 352),
  tag("5", 2.2, 0, 0, "", 0, 0, { temperature: 14.6, co2: 415, soil_moisture: 28.1 }, 21),
  tag("22", 2.77, -1.45, UP, "tulip_white", 1, 0, { soil_moisture: 42.2 }, 34),
  tag("3", 1.5, -0.2, DOWN, "tulip_red", 2, 1, { co2: 401, light: 831 }, 123),
  tag("7", -1.83, 1.45, DOWN, "", 0, 0, { light: 791 }, 52),
  tag("11", -2.2, 0, Math.PI, "tulip_pink", 3, 0, { humidity: 46.5 }, 63),
  tag("13", -2.77, -1.45, UP, "tulip_pink", 1, 0, { temperature: 26.9, humidity: 71.2 }, 108),
  tag("2", -1.5, -0.2, DOWN, "tulip_white", 3, 0, { temperature: 23.7, soil_moisture: 44.7 }, 340),
];

function tag(
  id: string,
  x: number,
  y: number,
  yaw: number,
  species: string,
  flowers: number,
  bugs: number,
  readings: Record<string, number>,
  ageS: number,
): Tag {
  return { id, pose: { x, y, yaw }, species, flowers, bugs, readings, ageS };
}

export interface Flower {
  x: number;
  y: number;
  heightM: number;
  species: string;
  bug: boolean;
}

/** The flowers of a tag, in a row behind it on its table. */
export function flowersOf({ pose, species, flowers, bugs }: Tag): Flower[] {
  const along = { x: -Math.sin(pose.yaw), y: Math.cos(pose.yaw) };
  return Array.from({ length: flowers }, (_, index) => {
    const offset = (index - (flowers - 1) / 2) * 0.17;
    const back = 0.13;
    return {
      x: pose.x - back * Math.cos(pose.yaw) + offset * along.x,
      y: pose.y - back * Math.sin(pose.yaw) + offset * along.y,
      heightM: TABLE_HEIGHT_M + 0.2 + 0.03 * ((index + species.length) % 3),
      species,
      bug: index < bugs,
    };
  });
}

/** The corners of the part of the table that belongs to a tag: front left, front right, back right, back left. */
export function boxOf({ pose }: Tag): { x: number; y: number }[] {
  const cos = Math.cos(pose.yaw);
  const sin = Math.sin(pose.yaw);
  const corner = (forward: number, left: number) => ({
    x: pose.x + forward * cos - left * sin,
    y: pose.y + forward * sin + left * cos,
  });
  return [corner(0, 0.3), corner(0, -0.3), corner(-0.4, -0.3), corner(-0.4, 0.3)];
}

export const FREE = 0;
export const WALL = 1;
export const TABLE = 2;
export const OUTSIDE = 3;

/** The content of each cell, in the order of an occupancy grid. */
export const CELLS: Uint8Array = buildCells();

function buildCells(): Uint8Array {
  const cells = new Uint8Array(WIDTH_CELLS * HEIGHT_CELLS).fill(OUTSIDE);
  fill(cells, { left: ROOM.left - WALL_M, right: ROOM.right + WALL_M, bottom: ROOM.bottom - WALL_M, top: ROOM.top + WALL_M }, WALL);
  fill(cells, ROOM, FREE);
  for (const table of TABLES) fill(cells, table, TABLE);
  return cells;
}

function fill(cells: Uint8Array, { left, right, bottom, top }: Box, value: number): void {
  const column = (x: number) => Math.round((x - ORIGIN.x) / RESOLUTION_M);
  const row = (y: number) => Math.round((y - ORIGIN.y) / RESOLUTION_M);
  for (let at = row(bottom); at < row(top); at += 1) cells.fill(value, at * WIDTH_CELLS + column(left), at * WIDTH_CELLS + column(right));
}

export function cellAt(x: number, y: number): number {
  const column = Math.floor((x - ORIGIN.x) / RESOLUTION_M);
  const row = Math.floor((y - ORIGIN.y) / RESOLUTION_M);
  if (column < 0 || row < 0 || column >= WIDTH_CELLS || row >= HEIGHT_CELLS) return OUTSIDE;
  return CELLS[row * WIDTH_CELLS + column] ?? OUTSIDE;
}

/** The occupancy grid: 100 occupied, 0 free, -1 unknown. What is inside a table was never seen. */
export function occupancy(): Int8Array {
  const grid = new Int8Array(CELLS.length);
  for (let index = 0; index < CELLS.length; index += 1) {
    const cell = CELLS[index];
    grid[index] = cell === FREE ? 0 : cell === OUTSIDE ? -1 : cell === TABLE && !isEdge(index) ? -1 : 100;
  }
  return grid;
}

function isEdge(index: number): boolean {
  return [1, -1, WIDTH_CELLS, -WIDTH_CELLS].some((step) => CELLS[index + step] === FREE);
}

/** The distance to the first cell that is not free from a point in a direction, m, and what it is. */
export function castRay(x: number, y: number, angle: number, reachM: number): { distanceM: number; hit: number } {
  const cos = Math.cos(angle);
  const sin = Math.sin(angle);
  const step = RESOLUTION_M * 0.5;
  for (let distance = 0; distance < reachM; distance += step) {
    const cell = cellAt(x + distance * cos, y + distance * sin);
    if (cell === FREE) continue;
    let [free, hit] = [Math.max(0, distance - step), distance];
    for (let halving = 0; halving < 5; halving += 1) {
      const middle = (free + hit) / 2;
      if (cellAt(x + middle * cos, y + middle * sin) === FREE) free = middle;
      else hit = middle;
    }
    return { distanceM: hit, hit: cell };
  }
  return { distanceM: reachM, hit: FREE };
}
