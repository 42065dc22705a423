/** How the mock cameras see the greenhouse: which of its parts appear where in their images. */
import { compose } from "@/ros/tf";
import { castRay, flowersOf, TAGS, TAG_EDGE_M, TAG_HEIGHT_M } from "./greenhouse";
import type { World } from "./world";

export const IMAGE = { width: 640, height: 480, focal: 554.25 } as const;

export interface Camera {
  x: number;
  y: number;
  z: number;
  yaw: number;
  /** Downwards, rad; drawn as a shift of the horizon. */
  pitch: number;
}

export function frontCamera({ pose }: World): Camera {
  const at = compose(pose, { x: 0.14, y: 0, yaw: 0 });
  return { ...at, z: 0.22, pitch: 0 };
}

/** The camera at the wrist turns with the arm and looks down at the tables. */
export function gripperCamera({ pose, arm }: World): Camera {
  const [pan = 0, lift = 0] = arm.position;
  const at = compose(pose, { x: 0.1, y: 0, yaw: pan });
  return { ...at, z: 0.62 + 0.1 * Math.sin(lift), pitch: 0.22 - 0.12 * lift };
}

export interface Pixel {
  u: number;
  v: number;
  depthM: number;
}

/** Where a point of the world is in an image; null where it is not in front of the camera. */
export function project(camera: Camera, x: number, y: number, z: number): Pixel | null {
  const [dx, dy] = [x - camera.x, y - camera.y];
  const forward = Math.cos(camera.yaw) * dx + Math.sin(camera.yaw) * dy;
  const left = -Math.sin(camera.yaw) * dx + Math.cos(camera.yaw) * dy;
  if (forward < 0.05) return null;
  return {
    u: IMAGE.width / 2 - (IMAGE.focal * left) / forward,
    v: horizon(camera) + (IMAGE.focal * (camera.z - z)) / forward,
    depthM: forward,
  };
}

export function horizon(camera: Camera): number {
  return IMAGE.height / 2 - IMAGE.focal * Math.tan(camera.pitch);
}

export interface SeenTag {
  id: string;
  corners: [number, number][];
  distanceM: number;
}

const TAG_REACH_M = 3.2;
const STEEPEST_RAD = 1.1;

/** The tags that a camera sees whole and from the front: top left, top right, bottom right, bottom left. */
export function seenTags(camera: Camera): SeenTag[] {
  const seen: SeenTag[] = [];
  for (const tag of TAGS) {
    const corners = tagCorners(tag.pose, TAG_EDGE_M).map(({ x, y, z }) => project(camera, x, y, z));
    const distance = Math.hypot(tag.pose.x - camera.x, tag.pose.y - camera.y);
    if (distance > TAG_REACH_M || !isFacing(camera, tag.pose) || isHidden(camera, tag.pose, distance)) continue;
    const inside = corners.filter((corner) => corner !== null && isInside(corner)) as Pixel[];
    if (inside.length < 4) continue;
    const depthM = inside.reduce((sum, corner) => sum + corner.depthM, 0) / 4;
    seen.push({ id: tag.id, corners: inside.map(({ u, v }) => [round(u), round(v)]), distanceM: depthM });
  }
  return seen;
}

/** The corners of a square on the front of a table, in the tag's order. */
export function tagCorners(pose: { x: number; y: number; yaw: number }, edgeM: number): { x: number; y: number; z: number }[] {
  const half = edgeM / 2;
  // To the right of a viewer who looks at the tag.
  const right = { x: -Math.sin(pose.yaw), y: Math.cos(pose.yaw) };
  return ([
    [-1, 1],
    [1, 1],
    [1, -1],
    [-1, -1],
  ] as const).map(([side, up]) => ({
    x: pose.x + side * half * right.x,
    y: pose.y + side * half * right.y,
    z: TAG_HEIGHT_M + up * half,
  }));
}

export interface SeenFlower {
  species: string;
  bug: boolean;
  u: number;
  v: number;
  sizePx: number;
  depthM: number;
  stemV: number;
}

const FLOWER_REACH_M = 3.5;
const FLOWER_M = 0.07;

/** The flowers in front of a camera, the farthest first. */
export function seenFlowers(camera: Camera, stemFootM: number): SeenFlower[] {
  const seen: SeenFlower[] = [];
  for (const tag of TAGS) {
    for (const flower of flowersOf(tag)) {
      const head = project(camera, flower.x, flower.y, flower.heightM);
      const foot = project(camera, flower.x, flower.y, stemFootM);
      if (head === null || foot === null || head.depthM > FLOWER_REACH_M) continue;
      const sizePx = (IMAGE.focal * FLOWER_M) / head.depthM;
      seen.push({ species: flower.species, bug: flower.bug, u: head.u, v: head.v, sizePx, depthM: head.depthM, stemV: foot.v });
    }
  }
  return seen.toSorted((a, b) => b.depthM - a.depthM);
}

function isFacing(camera: Camera, pose: { x: number; y: number; yaw: number }): boolean {
  const toCamera = Math.atan2(camera.y - pose.y, camera.x - pose.x);
  return Math.abs(Math.atan2(Math.sin(toCamera - pose.yaw), Math.cos(toCamera - pose.yaw))) < STEEPEST_RAD;
}

function isHidden(camera: Camera, pose: { x: number; y: number }, distance: number): boolean {
  const angle = Math.atan2(pose.y - camera.y, pose.x - camera.x);
  return castRay(camera.x, camera.y, angle, distance).distanceM < distance - 0.1;
}

function isInside({ u, v }: Pixel): boolean {
  return u > 2 && v > 2 && u < IMAGE.width - 2 && v < IMAGE.height - 2;
}

function round(value: number): number {
  return Math.round(value * 100) / 100;
}
