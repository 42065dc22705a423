/** Poses that the operator draws on the map: goals, the robot's pose, approaches of tags. */
import type {
  geometry_msgs_Pose,
  geometry_msgs_PoseStamped,
  geometry_msgs_PoseWithCovarianceStamped,
  std_msgs_Header,
} from "@/generated/messages";
import { nav2_msgs_ComputePathToPose_Result as ERRORS } from "@/generated/messages";
import type { TextKey } from "@/i18n/text";
import { type Pose2, wrapAngle } from "@/ros/tf";
import type { Point } from "./view";

/** RViz's standard deviations of a pose that was set by hand: 0.5 m and 15 degrees. */
const VARIANCE_M2 = 0.25;
const VARIANCE_RAD2 = (Math.PI / 12) ** 2;
/** A plan that ends within this distance leads to the goal; a robot within this distance has reached the goal. */
const NEAR_GOAL_M = 0.3;

/** The pose of a drag from `start` to `end`; without a drag it looks from the robot to the goal, as a driver would arrive. */
export function poseFromDrag(start: Point, end: Point, isHeadingSet: boolean, robot: Pose2 | null): Pose2 {
  if (isHeadingSet) return { ...start, yaw: Math.atan2(end.y - start.y, end.x - start.x) };
  if (robot === null) return { ...start, yaw: 0 };
  const distance = Math.hypot(start.x - robot.x, start.y - robot.y);
  return { ...start, yaw: distance < NEAR_GOAL_M ? robot.yaw : Math.atan2(start.y - robot.y, start.x - robot.x) };
}

/** A pose moved by the keyboard, along the screen's axes, and turned. */
export function nudge(pose: Pose2, rightM: number, upM: number, turnRad: number, turned: boolean): Pose2 {
  const sign = turned ? -1 : 1;
  return { x: pose.x + sign * rightM, y: pose.y + sign * upM, yaw: wrapAngle(pose.yaw + turnRad) };
}

/** A stamp of zero stands for the newest transforms. */
function header(frame: string): std_msgs_Header {
  return { stamp: { sec: 0, nanosec: 0 }, frame_id: frame };
}

function poseMessage({ x, y, yaw }: Pose2): geometry_msgs_Pose {
  return { position: { x, y, z: 0 }, orientation: { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) } };
}

export function goalMessage(pose: Pose2, frame: string): geometry_msgs_PoseStamped {
  return { header: header(frame), pose: poseMessage(pose) };
}

/** The robot's pose as the operator set it. The covariance is a plain array, since commands are sent as JSON. */
export function initialPoseMessage(pose: Pose2, frame: string): geometry_msgs_PoseWithCovarianceStamped {
  const covariance = new Array<number>(36).fill(0);
  covariance[0] = VARIANCE_M2;
  covariance[7] = VARIANCE_M2;
  covariance[35] = VARIANCE_RAD2;
  return { header: header(frame), pose: { pose: poseMessage(pose), covariance: covariance as unknown as Float64Array } };
}

/** Why no path leads to a goal, by the planner's error code. */
export function pathProblem(code: number): TextKey | null {
  switch (code) {
    case ERRORS.NONE:
      return null;
    case ERRORS.GOAL_OCCUPIED:
      return "map_goal_occupied";
    case ERRORS.GOAL_OUTSIDE_MAP:
      return "map_goal_outside";
    case ERRORS.START_OCCUPIED:
    case ERRORS.START_OUTSIDE_MAP:
      return "map_start_blocked";
    case ERRORS.TF_ERROR:
      return "map_robot_not_localized";
    case ERRORS.TIMEOUT:
      return "map_path_timeout";
    default:
      return "map_no_path";
  }
}

/** The outcome of a goal that was sent, judged by what the robot has published since. */
export type GoalProgress = "sent" | "driving" | "reached" | "unanswered";

export function goalProgress(goal: Pose2, sinceMs: number, plan: { end: Point | null; ageMs: number }, robot: Pose2 | null): GoalProgress {
  const isNear = (point: Point | null) => point !== null && Math.hypot(point.x - goal.x, point.y - goal.y) < NEAR_GOAL_M;
  const isPlanned = isNear(plan.end) && plan.ageMs < sinceMs;
  if (isPlanned && isNear(robot) && plan.ageMs > 1500) return "reached";
  if (isPlanned) return "driving";
  return sinceMs < 4000 ? "sent" : "unanswered";
}
