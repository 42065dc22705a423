/** The calibration of the arm's zero offsets: the robot's answer as rows of a table. */
import type { lupin_msgs_CalibrateArm_Response } from "@/generated/messages";

export type CalibrationState = "IDLE" | "AWAITING_POSE";
export type CalibrationAction = "start" | "commit" | "cancel" | "status";

export interface OffsetRow {
  joint: string;
  /** Encoder counts between the pose and the joint's zero, and those written as its offset; 0 if none was written. */
  difference: number;
  offset: number;
  /** The robot's remark about this joint. */
  remark: string;
}

export function calibrationState(state: string): CalibrationState | null {
  return state === "IDLE" || state === "AWAITING_POSE" ? state : null;
}

/** One row per joint. The message holds a remark per joint, as `elbow: offset 212; wrist: ...`. */
export function offsetRows(answer: lupin_msgs_CalibrateArm_Response): OffsetRow[] {
  return answer.joint_names.map((joint, index) => ({
    joint,
    difference: answer.diffs_observed[index] ?? NaN,
    offset: answer.offsets_applied[index] ?? NaN,
    remark: remarkOf(answer.message, joint, answer.joint_names[index + 1]),
  }));
}

/** The message's remark about a joint. It ends where the next joint's begins, because a remark may contain a semicolon. */
function remarkOf(message: string, joint: string, next: string | undefined): string {
  const start = message.indexOf(`${joint}: `);
  if (start < 0) return "";
  const end = next === undefined ? -1 : message.indexOf(`; ${next}: `, start);
  return message.slice(start + joint.length + 2, end < 0 ? undefined : end);
}
