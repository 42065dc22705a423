/** The arm's joints as the console shows them: names, limits, services, and the gripper's own scale. */
import { JOINTS, JOINT_SERVICES } from "@/generated/graph";
import type { sensor_msgs_JointState } from "@/generated/messages";
import { GRIPPER, JOINT_LIMITS } from "@/generated/robot";
import type { TextKey } from "@/i18n/text";
import { toDegrees } from "@/ui/numbers";

export type ArmJoint = (typeof JOINTS.arm)[number];
export type JointName = ArmJoint | typeof JOINTS.gripper;

export interface Joint {
  name: JointName;
  label: TextKey;
  hint: TextKey;
  /** The limits of commands in degrees; the gripper's are on the console's scale: -30 open, +30 closed. */
  lowerDeg: number;
  upperDeg: number;
  /** A joint has reached its target if it is within this tolerance. */
  toleranceDeg: number;
  service: (typeof JOINT_SERVICES)[JointName];
}

const ARM_TOLERANCE_DEG = 3;
const GRIPPER_TOLERANCE_DEG = 4;

const LABELS: Record<JointName, { label: TextKey; hint: TextKey }> = {
  shoulder_pan_joint: { label: "arm_pan", hint: "arm_pan_hint" },
  shoulder_lift_joint: { label: "arm_lift", hint: "arm_lift_hint" },
  elbow_joint: { label: "arm_elbow", hint: "arm_elbow_hint" },
  wrist_joint: { label: "arm_wrist", hint: "arm_wrist_hint" },
  gripper_joint: { label: "arm_gripper", hint: "arm_gripper_hint" },
};

function joint(name: JointName): Joint {
  const { lowerDeg, upperDeg } = JOINT_LIMITS[name];
  const isGripper = name === JOINTS.gripper;
  return {
    name,
    ...LABELS[name],
    lowerDeg,
    upperDeg,
    toleranceDeg: isGripper ? GRIPPER_TOLERANCE_DEG : ARM_TOLERANCE_DEG,
    service: JOINT_SERVICES[name],
  };
}

export const ARM: readonly Joint[] = [...JOINTS.arm, JOINTS.gripper].map(joint);

/** Angles in degrees by joint; a joint whose angle is unknown is missing. */
export type Angles = Partial<Record<JointName, number>>;

function rescale(value: number, [from, to]: readonly [number, number], [low, high]: readonly [number, number]): number {
  const share = Math.min(1, Math.max(0, (value - from) / (to - from)));
  return low + share * (high - low);
}

/** The console's scale of the gripper for the angle of its joint. */
export function gripperDegrees(angleRad: number): number {
  return rescale(angleRad, [GRIPPER.openRad, GRIPPER.closedRad], [GRIPPER.openDeg, GRIPPER.closedDeg]);
}

/** The angle of the gripper's joint for a value of the console's scale. */
export function gripperRadians(degrees: number): number {
  return rescale(degrees, [GRIPPER.openDeg, GRIPPER.closedDeg], [GRIPPER.openRad, GRIPPER.closedRad]);
}

/** The arm's angles in a message: joints that are missing or not a number are left out. */
export function measuredAngles(message: Pick<sensor_msgs_JointState, "name" | "position">): Angles {
  const angles: Angles = {};
  for (const { name } of ARM) {
    const radians = message.position[message.name.indexOf(name)];
    if (radians === undefined || !Number.isFinite(radians)) continue;
    angles[name] = name === JOINTS.gripper ? gripperDegrees(radians) : toDegrees(radians);
  }
  return angles;
}

/** The angles of four joints in rad, in the order of the graph's table, such as a preset's. */
export function anglesOf(radians: readonly number[]): Angles {
  return Object.fromEntries(JOINTS.arm.map((name, index) => [name, toDegrees(radians[index] ?? NaN)])) as Angles;
}

export function clampToLimits({ lowerDeg, upperDeg }: Joint, degrees: number): number {
  return Math.min(upperDeg, Math.max(lowerDeg, degrees));
}
