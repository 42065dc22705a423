/** Where the robot goes and where it was: the plan and the driven trail. */
import type { nav_msgs_Path } from "@/generated/messages";
import type { Pose2 } from "@/ros/tf";
import type { Point } from "./view";

/** While the robot drives, a plan comes about once a second; one older than this is no longer followed. */
export const PLAN_STALE_MS = 3000;
/** After this, an old plan is no longer drawn at all. */
export const PLAN_FORGOTTEN_MS = 20_000;

/** The points of a path; those that are not finite are passed over. */
export function readPath(message: Pick<nav_msgs_Path, "poses"> | null | undefined): Point[] {
  const points: Point[] = [];
  for (const each of message?.poses ?? []) {
    const position = each?.pose?.position;
    if (Number.isFinite(position?.x) && Number.isFinite(position?.y)) points.push({ x: position.x, y: position.y });
  }
  return points;
}

export function lengthOf(points: readonly Point[]): number {
  let length = 0;
  for (let index = 1; index < points.length; index += 1) {
    const [from, to] = [points[index - 1], points[index]];
    if (from !== undefined && to !== undefined) length += Math.hypot(to.x - from.x, to.y - from.y);
  }
  return length;
}

/** What is left of a path for a robot at `pose`: it begins at the robot, and goes on after the nearest point. */
export function remaining(points: readonly Point[], pose: Point | null): Point[] {
  if (pose === null || points.length === 0) return [...points];
  let [nearest, best] = [0, Infinity];
  points.forEach((point, index) => {
    const distance = Math.hypot(point.x - pose.x, point.y - pose.y);
    if (distance < best) [nearest, best] = [index, distance];
  });
  return [{ x: pose.x, y: pose.y }, ...points.slice(nearest + 1)];
}

/** A plan whose end is nearer than this was driven. */
const DRIVEN_M = 0.12;

/** What is to be drawn of a plan, and whether the robot still follows it; null where it was driven or is too old. */
export function shownPlan(
  plan: { points: readonly Point[]; receivedMs: number } | null,
  pose: Point | null,
  nowMs: number,
): { left: Point[]; isFollowed: boolean } | null {
  if (plan === null || plan.points.length < 2) return null;
  const ageMs = nowMs - plan.receivedMs;
  if (ageMs > PLAN_FORGOTTEN_MS) return null;
  const left = remaining(plan.points, pose);
  if (left.length < 2 || lengthOf(left) < DRIVEN_M) return null;
  return { left, isFollowed: ageMs <= PLAN_STALE_MS };
}

export interface TrailPoint extends Point {
  /** performance.now() when the robot was there. */
  atMs: number;
  /** Whether the trail begins anew here: the robot was not followed up to this point. */
  begins: boolean;
}

const STEP_M = 0.03;
/** A pose that lies so far from the last one was corrected by SLAM, or was not followed in between. */
const JUMP_M = 0.6;
const LONGEST = 5000;

export class Trail {
  points: TrailPoint[] = [];

  /** Add a pose; returns whether the trail became longer. */
  add(pose: Pose2, atMs: number): boolean {
    const last = this.points.at(-1);
    const distance = last === undefined ? Infinity : Math.hypot(pose.x - last.x, pose.y - last.y);
    if (distance < STEP_M) return false;
    this.points.push({ x: pose.x, y: pose.y, atMs, begins: distance > JUMP_M });
    if (this.points.length > LONGEST) this.points.splice(0, this.points.length - LONGEST);
    return true;
  }

  clear(): void {
    this.points = [];
  }
}
