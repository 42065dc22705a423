/** The path of the mock robot: a figure eight around the middle of the greenhouse. */
import type { Pose2 } from "@/ros/tf";

const LENGTH_M = 3;
const WIDTH_M = 0.8;
const RATE_RAD_S = 0.15;

/** How long the robot would take for the whole figure, s. */
export const FIGURE_PERIOD_S = (2 * Math.PI) / RATE_RAD_S;

/** The pose on the figure after `t` s, looking along it. */
export function figureEight(t: number): Pose2 {
  const angle = RATE_RAD_S * t;
  const x = LENGTH_M * Math.sin(angle);
  const y = WIDTH_M * Math.sin(2 * angle);
  const dx = LENGTH_M * Math.cos(angle);
  const dy = 2 * WIDTH_M * Math.cos(2 * angle);
  return { x, y, yaw: Math.atan2(dy, dx) };
}
