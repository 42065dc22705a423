/** The battery's state of charge, and what it means for the robot. */

/** Below this share the robot ends its mission and returns (safety/battery_monitor). */
const LOW_SHARE = 0.2;
/** Below this share a person should think of it. */
const SOON_SHARE = 0.35;

export type Charge = "unknown" | "good" | "soon" | "low";

/** The charge as a share of 1; null where the driver knows only the voltage. Some drivers report percent. */
export function chargeShare(percentage: number | null | undefined): number | null {
  if (percentage === null || percentage === undefined || !Number.isFinite(percentage) || percentage < 0) return null;
  return Math.min(1, percentage > 1 ? percentage / 100 : percentage);
}

export function chargeOf(share: number | null): Charge {
  if (share === null) return "unknown";
  return share < LOW_SHARE ? "low" : share < SOON_SHARE ? "soon" : "good";
}
