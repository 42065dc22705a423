/** Occupancy grids for tests. */
import type { nav_msgs_OccupancyGrid } from "@/generated/messages";

/** A grid from rows of characters, the last row first: `.` free, `#` wall, `?` unknown, `~` half known. */
export function gridMessage(rows: string[], resolution = 0.5, yaw = 0): nav_msgs_OccupancyGrid {
  const values: Record<string, number> = { ".": 0, "#": 100, "?": -1, "~": 50 };
  const time = { sec: 0, nanosec: 0 };
  return {
    header: { stamp: time, frame_id: "map" },
    info: {
      map_load_time: time,
      resolution,
      width: rows[0]?.length ?? 0,
      height: rows.length,
      origin: { position: { x: 1, y: 2, z: 0 }, orientation: { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) } },
    },
    data: Int8Array.from(rows.toReversed().join(""), (character) => values[character] ?? -1),
  };
}
