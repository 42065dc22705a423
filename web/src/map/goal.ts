/** Poses that the operator draws on the map: goals, the robot's pose, approaches of tags. */
import type {
  action_msgs_GoalStatus,
  geometry_msgs_Pose,
  geometry_msgs_PoseStamped,
  geometry_msgs_PoseWithCovarianceStamped,
  std_msgs_Header,
} from "@/generated/messages";
import { nav2_msgs_ComputePathToPose_Result as ERRORS, action_msgs_GoalStatus as STATES } from "@/generated/messages";
import type { TextKey } from "@/i18n/text";
import { type Pose2, wrapAngle } from "@/ros/tf";
import type { Point } from "./view";

/** RViz's standard deviations of a pose that was set by hand: 0.5 m and 15 degrees. */
const VARIANCE_M2 = 0.25;
const VARIANCE_RAD2 = (Math.PI / 12) ** 2;
/** A plan that ends within this distance leads to the goal; from within this distance, a robot turns instead of driving there. */
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

/** What became of a goal that was sent, by what navigation says of it. */
export type GoalProgress = "sent" | "driving" | "reached" | "ended" | "unanswered";

const ANSWER_WITHIN_MS = 4000;

export function goalProgress(sinceMs: number, status: number | null): GoalProgress {
  switch (status) {
    case null:
    case STATES.STATUS_UNKNOWN:
      return sinceMs < ANSWER_WITHIN_MS ? "sent" : "unanswered";
    case STATES.STATUS_SUCCEEDED:
      return "reached";
    case STATES.STATUS_CANCELED:
    case STATES.STATUS_ABORTED:
      return "ended";
    default:
      return "driving";
  }
}

export function idsOf(statuses: readonly action_msgs_GoalStatus[]): Set<string> {
  return new Set(statuses.map(idOf));
}

function idOf({ goal_info }: action_msgs_GoalStatus): string {
  return Array.from(goal_info.goal_id.uuid).join();
}

/** The status of the newest goal that navigation did not know when ours was sent; null without one. */
export function statusSince(statuses: readonly action_msgs_GoalStatus[], known: ReadonlySet<string>): number | null {
  const seconds = ({ goal_info: { stamp } }: action_msgs_GoalStatus) => stamp.sec + stamp.nanosec / 1e9;
  const newer = statuses.filter((each) => !known.has(idOf(each)));
  return newer.reduce<action_msgs_GoalStatus | null>((best, each) => (best === null || seconds(each) >= seconds(best) ? each : best), null)?.status ?? null;
}

/** How far from the goal a plan ends that came since it was sent, m; null where it leads there, or none has come. */
export function besideGoalM(goal: Point, sinceMs: number, plan: { end: Point | null; ageMs: number }): number | null {
  if (plan.end === null || plan.ageMs >= sinceMs) return null;
  const distance = Math.hypot(plan.end.x - goal.x, plan.end.y - goal.y);
  return distance < NEAR_GOAL_M ? null : distance;
}
