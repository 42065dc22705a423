/**
 * The last command of each joint, and whether the joint has reached its target.
 *
 * An answered service call does not prove that the arm moved. A joint has settled once /joint_states shows it within its
 * tolerance of the target. It has stalled if it has not settled within the move's expected duration, because its controller
 * refused the angle or its servo switched itself off.
 */
import { JOINTS } from "@/generated/graph";
import type { trajectory_msgs_JointTrajectory } from "@/generated/messages";
import { toDegrees } from "@/ui/numbers";
import type { Angles, Joint, JointName } from "./joints";

/** Added to a move's duration for the latency of the command and of the feedback. */
const SLACK_MS = 1000;
/** Time allowed for a move of the gripper, which is force-controlled and ignores the commanded rate. */
const GRIPPER_MS = 2500;

export interface Command {
  targetDeg: number;
  /** The value of performance.now() at which the joint should have reached the target. */
  dueMs: number;
}

export type Commands = Partial<Record<JointName, Command>>;
export type JointPhase = "unknown" | "idle" | "moving" | "settled" | "stalled";

/** The joint's phase, from its last command and its measured angle. `measuredDeg` is undefined without fresh feedback. */
export function jointPhase(joint: Joint, command: Command | undefined, measuredDeg: number | undefined, nowMs: number): JointPhase {
  if (measuredDeg === undefined) return "unknown";
  if (command === undefined) return "idle";
  if (Math.abs(measuredDeg - command.targetDeg) <= joint.toleranceDeg) return "settled";
  return nowMs < command.dueMs ? "moving" : "stalled";
}

/** The command of one move of one joint at a rate in degrees per second. */
export function jointCommand(joint: Joint, targetDeg: number, fromDeg: number | undefined, rateDegPerSec: number, nowMs: number): Command {
  const isGripper = joint.name === JOINTS.gripper;
  const moveMs = (Math.abs(targetDeg - (fromDeg ?? targetDeg)) / rateDegPerSec) * 1000;
  return { targetDeg, dueMs: nowMs + (isGripper ? GRIPPER_MS : moveMs + SLACK_MS) };
}

/** The commands of a move of several joints that takes a known time. */
export function moveCommands(targets: Angles, durationS: number, nowMs: number): Commands {
  const commands: Commands = {};
  for (const [name, targetDeg] of Object.entries(targets)) {
    if (Number.isFinite(targetDeg)) commands[name as JointName] = { targetDeg, dueMs: nowMs + durationS * 1000 + SLACK_MS };
  }
  return commands;
}

/**
 * The commands in a trajectory on the arm controller's topic, whoever sent it: a preset, a mission, a replay or another console.
 */
export function trajectoryCommands(message: trajectory_msgs_JointTrajectory, nowMs: number): Commands {
  const last = message.points.at(-1);
  if (last === undefined) return {};
  const targets: Angles = {};
  for (const name of JOINTS.arm) {
    const radians = last.positions[message.joint_names.indexOf(name)];
    if (radians !== undefined) targets[name] = toDegrees(radians);
  }
  return moveCommands(targets, last.time_from_start.sec + last.time_from_start.nanosec / 1e9, nowMs);
}
