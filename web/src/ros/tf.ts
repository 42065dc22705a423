/** The transforms of the graph, and the chain of them from one frame to another. */
import type { geometry_msgs_Quaternion as Quaternion, geometry_msgs_Vector3 as Vector, tf2_msgs_TFMessage } from "@/generated/messages";

export type { Quaternion, Vector };

export const MAX_HOPS = 32;
export const MOVED_M = 0.005;
export const MOVED_RAD = 0.005;

/** A pose in the plane: m and rad. */
export interface Pose2 {
  x: number;
  y: number;
  yaw: number;
}

/** The pose of a frame in another: where its origin is, and how it is turned. */
export interface Transform {
  translation: Vector;
  rotation: Quaternion;
}

interface Edge extends Transform {
  parent: string;
}

export const IDENTITY: Transform = { translation: { x: 0, y: 0, z: 0 }, rotation: { x: 0, y: 0, z: 0, w: 1 } };

export function wrapAngle(angle: number): number {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}

export function yawOf({ x, y, z, w }: Quaternion): number {
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

function multiply(a: Quaternion, b: Quaternion): Quaternion {
  return {
    x: a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
    y: a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
    z: a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    w: a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
  };
}

/** A vector turned by a rotation: v + 2w(q x v) + 2q x (q x v). */
export function rotate({ x: qx, y: qy, z: qz, w }: Quaternion, { x, y, z }: Vector): Vector {
  const [tx, ty, tz] = [2 * (qy * z - qz * y), 2 * (qz * x - qx * z), 2 * (qx * y - qy * x)];
  return { x: x + w * tx + qy * tz - qz * ty, y: y + w * ty + qz * tx - qx * tz, z: z + w * tz + qx * ty - qy * tx };
}

/** A point of a frame in the frame's parent. */
export function transformPoint({ translation, rotation }: Transform, point: Vector): Vector {
  const { x, y, z } = rotate(rotation, point);
  return { x: translation.x + x, y: translation.y + y, z: translation.z + z };
}

export function chain(outer: Transform, inner: Transform): Transform {
  return { translation: transformPoint(outer, inner.translation), rotation: multiply(outer.rotation, inner.rotation) };
}

/** A transform as seen from above. */
export function planar({ translation: { x, y }, rotation }: Transform): Pose2 {
  return { x, y, yaw: yawOf(rotation) };
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
      const { x, y, z, w } = transform.rotation;
      const { translation } = transform;
      const length = Math.hypot(x, y, z, w);
      if (!Number.isFinite(length + translation.x + translation.y + translation.z)) continue;
      const rotation = length > 0 ? { x: x / length, y: y / length, z: z / length, w: w / length } : IDENTITY.rotation;
      this.edges.set(frameName(child_frame_id), { parent: frameName(header.frame_id), translation, rotation });
    }
  }

  clear(): void {
    this.edges.clear();
  }

  /** The pose of `frame` in `root` as seen from above; null as `transform` is. */
  lookUp(root: string, frame: string): Pose2 | null {
    const found = this.transform(root, frame);
    return found === null ? null : planar(found);
  }

  /** The transform of `frame` to `root`; null without a chain of at most MAX_HOPS transforms, as in a cycle. */
  transform(root: string, frame: string): Transform | null {
    let result = IDENTITY;
    let current = frameName(frame);
    const end = frameName(root);
    for (let hop = 0; hop <= MAX_HOPS; hop += 1) {
      if (current === end) return result;
      const edge = this.edges.get(current);
      if (edge === undefined) return null;
      result = chain(edge, result);
      current = edge.parent;
    }
    return null;
  }
}

/** The name of a frame without the leading slash, which tf2 dropped and old drivers still write. */
export function frameName(name: string): string {
  return name.startsWith("/") ? name.slice(1) : name;
}
