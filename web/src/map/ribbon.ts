/** A path as a flat band on the floor: lines in WebGL are one pixel wide. */
import type { Point } from "./view";

export interface Ribbon {
  /** Two corners per point, left and right of the path: x, y, z. */
  positions: Float32Array;
  indices: Uint32Array;
}

/** A band of `widthM` along the points; points that lie on one another are passed over. */
export function ribbon(points: readonly Point[], widthM: number, z: number): Ribbon {
  const path = points.filter((point, index) => {
    const before = points[index - 1];
    return before === undefined || Math.hypot(point.x - before.x, point.y - before.y) > 1e-4;
  });
  if (path.length < 2) return { positions: new Float32Array(), indices: new Uint32Array() };
  const positions = new Float32Array(path.length * 6);
  path.forEach((point, index) => {
    const from = path[Math.max(0, index - 1)] ?? point;
    const to = path[Math.min(path.length - 1, index + 1)] ?? point;
    const length = Math.hypot(to.x - from.x, to.y - from.y) || 1;
    const across = { x: (-(to.y - from.y) / length) * (widthM / 2), y: ((to.x - from.x) / length) * (widthM / 2) };
    positions.set([point.x + across.x, point.y + across.y, z, point.x - across.x, point.y - across.y, z], index * 6);
  });
  const indices = new Uint32Array((path.length - 1) * 6);
  for (let index = 0; index < path.length - 1; index += 1) {
    const first = index * 2;
    indices.set([first, first + 1, first + 2, first + 1, first + 3, first + 2], index * 6);
  }
  return { positions, indices };
}
