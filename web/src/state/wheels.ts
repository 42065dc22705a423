/** Whether the wheels turn, as odometry measures it. */
import type { nav_msgs_Odometry } from "@/generated/messages";

/** `unknown`: odometry is missing, out of date, or has not been at rest for long enough. */
export type Wheels = "turning" | "standing" | "unknown";

/** Faster than this, in m/s and rad/s, the robot moves. */
const MOVING_MPS = 0.02;
const MOVING_RPS = 0.05;
/** A change of direction passes through zero, so the wheels stand only after this time below both limits. */
const STANDS_AFTER_MS = 300;
/** Odometry comes 50 times a second; older than this, it says nothing about now. */
export const ODOMETRY_STALE_MS = 1000;

export interface WheelsReading {
  state: Wheels;
  /** Since when both speeds are below their limits; null while one is above. */
  slowSinceMs: number | null;
  lastMs: number;
}

/** The reading after one more sample. One without numbers changes nothing, so that the reading becomes out of date. */
export function nextReading(before: WheelsReading | null, { linear, angular }: nav_msgs_Odometry["twist"]["twist"], atMs: number): WheelsReading | null {
  const speed = Math.hypot(linear.x, linear.y);
  const turn = Math.abs(angular.z);
  if (!Number.isFinite(speed + turn)) return before;
  if (speed > MOVING_MPS || turn > MOVING_RPS) return { state: "turning", slowSinceMs: null, lastMs: atMs };
  const last = before !== null && atMs - before.lastMs <= ODOMETRY_STALE_MS ? before : null;
  const slowSinceMs = last?.slowSinceMs ?? atMs;
  return { state: atMs - slowSinceMs >= STANDS_AFTER_MS ? "standing" : (last?.state ?? "unknown"), slowSinceMs, lastMs: atMs };
}

export function wheelsAt(reading: WheelsReading | null, nowMs: number): Wheels {
  return reading !== null && nowMs - reading.lastMs <= ODOMETRY_STALE_MS ? reading.state : "unknown";
}
