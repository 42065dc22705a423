/** The battery's state of charge, and what it means for the robot. */

import { BATTERY } from "@/generated/robot";

export type Charge = "unknown" | "good" | "soon" | "low";

/** The charge from 0 to 1; null if the driver knows only the voltage. Some drivers report percent. */
export function chargeShare(percentage: number | null | undefined): number | null {
  if (percentage === null || percentage === undefined || !Number.isFinite(percentage) || percentage < 0) return null;
  return Math.min(1, percentage > 1 ? percentage / 100 : percentage);
}

/** `soon`: a person should think of it. `low`: the robot ends its mission and returns. */
export function chargeOf(share: number | null): Charge {
  if (share === null) return "unknown";
  return share < BATTERY.lowShare ? "low" : share < BATTERY.soonShare ? "soon" : "good";
}
