/** Angles of a quaternion, as people read them. */
import type { geometry_msgs_Quaternion } from "@/generated/messages";
import { toDegrees } from "@/ui/numbers";

export interface Orientation {
  rollDeg: number;
  pitchDeg: number;
  yawDeg: number;
}

/** Roll, pitch and yaw in degrees (z-y-x); null if the quaternion is not normalized or not a number. */
export function orientation({ x, y, z, w }: geometry_msgs_Quaternion): Orientation | null {
  const length = Math.hypot(x, y, z, w);
  if (!(Math.abs(length - 1) < 0.05)) return null;
  return {
    rollDeg: toDegrees(Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))),
    pitchDeg: toDegrees(Math.asin(Math.min(1, Math.max(-1, 2 * (w * y - z * x))))),
    yawDeg: toDegrees(Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))),
  };
}
