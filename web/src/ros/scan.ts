/** A laser scan seen from above: the one projection for the map and the scan around the robot, as lupin_runtime/laser_scan.py does it. */
import type { sensor_msgs_LaserScan } from "@/generated/messages";
import { LIDAR } from "@/generated/robot";
import { type Pose2, type Transform, planar } from "./tf";

/** The scans of a laser that is tilted by more do not show one level: they are not drawn. */
const MAX_TILT_RAD = (3 * Math.PI) / 180;

/** The pose of a laser as seen from above. Where it hangs upside down, its beams go round clockwise. */
export interface Mount extends Pose2 {
  upsideDown: boolean;
}

/** The mount by the robot's model, without a transform of the laser. */
export const MODEL_MOUNT: Mount = { x: LIDAR.at[0], y: LIDAR.at[1], yaw: LIDAR.yawRad, upsideDown: false };

/** The mount of a laser; null if it is tilted. */
export function mountOf(laser: Transform): Mount | null {
  const { x, y } = laser.rotation;
  const up = 1 - 2 * (x * x + y * y);
  return Math.abs(up) < Math.cos(MAX_TILT_RAD) ? null : { ...planar(laser), upsideDown: up < 0 };
}

/** The echoes of a scan as pairs of x and y; rays without one are left out. A range limit of 0 is none. */
export function echoesOf(scan: sensor_msgs_LaserScan, laser: Mount): Float32Array {
  const points = new Float32Array(scan.ranges.length * 2);
  const turn = laser.upsideDown ? -1 : 1;
  const nearest = scan.range_min > 0 ? scan.range_min : 0;
  const farthest = scan.range_max > 0 ? scan.range_max : Infinity;
  let count = 0;
  for (let ray = 0; ray < scan.ranges.length; ray += 1) {
    const range = scan.ranges[ray] ?? NaN;
    if (!(range > 0 && range >= nearest && range <= farthest && range < Infinity)) continue;
    const angle = laser.yaw + turn * (scan.angle_min + ray * scan.angle_increment);
    if (!Number.isFinite(angle)) continue;
    points[count] = laser.x + range * Math.cos(angle);
    points[count + 1] = laser.y + range * Math.sin(angle);
    count += 2;
  }
  return points.slice(0, count);
}
