/**
 * The robot as the simulator has it: its bodies with their shapes, and where they are for positions of its joints. Every view of
 * the robot draws this model.
 */
import { JOINTS } from "@/generated/graph";
import { GRIPPER } from "@/generated/robot";
import rows from "@/generated/robot_model.json";
import { IDENTITY, type Quaternion, type Transform, type Vector, chain } from "@/ros/tf";

export interface Shape {
  kind: "box" | "cylinder";
  name: string;
  /** m; half of a box's edges, or a cylinder's radius and half of its length along z. */
  size: Vector;
  /** In its body. */
  pose: Transform;
  /** Red, green and blue, 0 to 1, sRGB. */
  color: readonly number[];
}

export interface Body {
  name: string;
  /** Empty for the base. */
  parent: string;
  /** In its parent, with its joint at 0. */
  pose: Transform;
  /** Empty where it is fixed. */
  joint: string;
  axis: Vector;
  /** Whether its joint slides along its axis instead of turning about it. */
  slides: boolean;
  shapes: readonly Shape[];
}

function vector([x = 0, y = 0, z = 0]: readonly number[]): Vector {
  return { x, y, z };
}

function quaternion([x = 0, y = 0, z = 0, w = 1]: readonly number[]): Quaternion {
  return { x, y, z, w };
}

function poseOf({ at, turned }: { at: readonly number[]; turned: readonly number[] }): Transform {
  return { translation: vector(at), rotation: quaternion(turned) };
}

/** A body comes after its parent. */
export const BODIES: readonly Body[] = rows.map((row) => ({
  ...row,
  pose: poseOf(row),
  axis: vector(row.axis),
  shapes: row.shapes.map((shape) => ({ ...shape, kind: shape.kind as Shape["kind"], size: vector(shape.size), pose: poseOf(shape) })),
}));

/** Half of the gap between the fingers, m, at a position of the gripper's joint. */
export function fingerOffset(gripperRad: number): number {
  const { openRad, closedRad, openApertureM, closedApertureM } = GRIPPER;
  const share = Math.min(1, Math.max(0, (gripperRad - openRad) / (closedRad - openRad)));
  return (openApertureM + (closedApertureM - openApertureM) * share) / 2;
}

/** A joint's turn about its axis in rad, or its slide along it in m. */
function jointTransform({ axis: { x, y, z }, slides }: Body, value: number): Transform {
  if (slides) return { translation: { x: x * value, y: y * value, z: z * value }, rotation: IDENTITY.rotation };
  const sine = Math.sin(value / 2);
  return { translation: IDENTITY.translation, rotation: { x: x * sine, y: y * sine, z: z * sine, w: Math.cos(value / 2) } };
}

/** The pose of every body in the base, by its name, for positions of joints in rad. A joint that is unknown counts as 0. */
export function bodyPoses(positions: ReadonlyMap<string, number>): Map<string, Transform> {
  const poses = new Map<string, Transform>();
  for (const body of BODIES) {
    const value = body.slides ? fingerOffset(positions.get(JOINTS.gripper) ?? 0) : (positions.get(body.joint) ?? 0);
    poses.set(body.name, chain(chain(poses.get(body.parent) ?? IDENTITY, body.pose), jointTransform(body, value)));
  }
  return poses;
}
