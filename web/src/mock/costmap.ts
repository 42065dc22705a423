/** The mock costmaps: the map with its obstacles inflated by the robot's size. */
import type { nav_msgs_OccupancyGrid } from "@/generated/messages";
import { CELLS, FREE, HEIGHT_CELLS, ORIGIN, OUTSIDE, RESOLUTION_M, WIDTH_CELLS } from "./greenhouse";
import { header, pose, time } from "./messages";
import type { World } from "./world";

const INFLATED_CELLS = 8;
const LOCAL_CELLS = 60;

let global: Int8Array | null = null;

/** Costs from 0 to 100, -1 unknown. */
export function costmap(): Int8Array {
  global ??= inflated();
  return global;
}

function inflated(): Int8Array {
  const costs = new Int8Array(CELLS.length);
  for (let index = 0; index < CELLS.length; index += 1) {
    const cell = CELLS[index];
    if (cell === OUTSIDE) costs[index] = -1;
    if (cell === FREE || cell === OUTSIDE) continue;
    spread(costs, index % WIDTH_CELLS, Math.floor(index / WIDTH_CELLS));
  }
  return costs;
}

function spread(costs: Int8Array, column: number, row: number): void {
  for (let dy = -INFLATED_CELLS; dy <= INFLATED_CELLS; dy += 1) {
    for (let dx = -INFLATED_CELLS; dx <= INFLATED_CELLS; dx += 1) {
      const [x, y] = [column + dx, row + dy];
      const distance = Math.hypot(dx, dy);
      if (distance > INFLATED_CELLS || x < 0 || y < 0 || x >= WIDTH_CELLS || y >= HEIGHT_CELLS) continue;
      const at = y * WIDTH_CELLS + x;
      if (CELLS[at] === OUTSIDE) continue;
      costs[at] = Math.max(costs[at] ?? 0, distance === 0 ? 100 : Math.round(99 * (1 - distance / (INFLATED_CELLS + 1))));
    }
  }
}

/** The part of the costmap around the robot. */
export function localCostmap(world: World): nav_msgs_OccupancyGrid {
  const first = {
    column: Math.round((world.pose.x - ORIGIN.x) / RESOLUTION_M) - LOCAL_CELLS / 2,
    row: Math.round((world.pose.y - ORIGIN.y) / RESOLUTION_M) - LOCAL_CELLS / 2,
  };
  const data = new Int8Array(LOCAL_CELLS * LOCAL_CELLS).fill(-1);
  const costs = costmap();
  for (let row = 0; row < LOCAL_CELLS; row += 1) {
    for (let column = 0; column < LOCAL_CELLS; column += 1) {
      const [x, y] = [first.column + column, first.row + row];
      if (x < 0 || y < 0 || x >= WIDTH_CELLS || y >= HEIGHT_CELLS) continue;
      data[row * LOCAL_CELLS + column] = costs[y * WIDTH_CELLS + x] ?? -1;
    }
  }
  const origin = { x: ORIGIN.x + first.column * RESOLUTION_M, y: ORIGIN.y + first.row * RESOLUTION_M, yaw: 0 };
  return {
    header: header(world.clockS, "map"),
    info: { map_load_time: time(world.clockS), resolution: RESOLUTION_M, width: LOCAL_CELLS, height: LOCAL_CELLS, origin: pose(origin) },
    data,
  };
}
