/** The transforms of the graph, and the chain of planar poses from one frame to another. */
import type { tf2_msgs_TFMessage } from "@/generated/messages";

export const MAX_HOPS = 32;
export const MOVED_M = 0.005;
export const MOVED_RAD = 0.005;

/** A pose in the plane: m and rad. */
export interface Pose2 {
  x: number;
  y: number;
  yaw: number;
}

interface Edge {
  parent: string;
  pose: Pose2;
}

export function wrapAngle(angle: number): number {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}

export function yawOf({ x, y, z, w }: { x: number; y: number; z: number; w: number }): number {
  return Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
}

/** The pose `inner`, which is given in the frame of `outer`, in the frame of `outer`'s parent. */
export function compose(outer: Pose2, inner: Pose2): Pose2 {
  const cos = Math.cos(outer.yaw);
  const sin = Math.sin(outer.yaw);
  return {
    x: outer.x + cos * inner.x - sin * inner.y,
    y: outer.y + sin * inner.x + cos * inner.y,
    yaw: wrapAngle(outer.yaw + inner.yaw),
  };
}

export function hasMoved(before: Pose2 | null, after: Pose2): boolean {
  if (before === null) return true;
  const distance = Math.hypot(after.x - before.x, after.y - before.y);
  return distance > MOVED_M || Math.abs(wrapAngle(after.yaw - before.yaw)) > MOVED_RAD;
}

export class TransformTree {
  private edges = new Map<string, Edge>();

  /** Take the transforms of a message; values that are not finite are passed over. */
  update(message: tf2_msgs_TFMessage): void {
    for (const { header, child_frame_id, transform } of message.transforms) {
      const pose = { x: transform.translation.x, y: transform.translation.y, yaw: yawOf(transform.rotation) };
      if (Number.isFinite(pose.x) && Number.isFinite(pose.y) && Number.isFinite(pose.yaw)) {
        this.edges.set(frameName(child_frame_id), { parent: frameName(header.frame_id), pose });
      }
    }
  }

  clear(): void {
    this.edges.clear();
  }

  /** The pose of `frame` in `root`; null without a chain of at most MAX_HOPS transforms, as in a cycle. */
  lookUp(root: string, frame: string): Pose2 | null {
    let pose: Pose2 = { x: 0, y: 0, yaw: 0 };
    let current = frameName(frame);
    const end = frameName(root);
    for (let hop = 0; hop <= MAX_HOPS; hop += 1) {
      if (current === end) return pose;
      const edge = this.edges.get(current);
      if (edge === undefined) return null;
      pose = compose(edge.pose, pose);
      current = edge.parent;
    }
    return null;
  }
}

function frameName(name: string): string {
  return name.startsWith("/") ? name.slice(1) : name;
}
