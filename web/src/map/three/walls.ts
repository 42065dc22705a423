/** A lidar sees no heights: all walls are drawn as high as the greenhouse's boxes are by default. */
export const WALL_M = 0.3;

/** A stem where the bloom's height is not known. */
const STEM_M = 0.16;

/** Where a flower's stem begins and how long it is, m: it grows out of its box. */
export function stemOf(flower: { z: number; heightM: number }): { baseM: number; lengthM: number } {
  return { baseM: WALL_M, lengthM: Math.max(STEM_M, flower.z + flower.heightM - WALL_M) };
}
