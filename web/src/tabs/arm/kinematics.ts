/** The arm's pose for the console's angles, and its joints as lines. */
import { JOINTS } from "@/generated/graph";
import { halfExtents } from "@/robot/footprint";
import { BODIES, bodyPoses } from "@/robot/model";
import { IDENTITY, type Transform, type Vector, transformPoint } from "@/ros/tf";
import { toRadians } from "@/ui/numbers";
import { ARM, type Angles, gripperRadians } from "./joints";

/** The pose of every body by its name; a joint that is unknown counts as 0. */
export function armPoses(angles: Angles): Map<string, Transform> {
  const positions = ARM.map(({ name }) => [name, name === JOINTS.gripper ? gripperRadians(angles[name] ?? 0) : toRadians(angles[name] ?? 0)] as const);
  return bodyPoses(new Map(positions));
}

/** The end of a body along its own z axis, m. */
function lengthOf(name: string): number {
  const shapes = BODIES.find((body) => body.name === name)?.shapes ?? [];
  return Math.max(0, ...shapes.map((shape) => shape.pose.translation.z + halfExtents(shape).z));
}

/** The arm as lines: the joints from pan to wrist and the palm, and the two fingers. */
export function skeleton(angles: Angles): { chain: Vector[]; fingers: [Vector, Vector][] } {
  const poses = armPoses(angles);
  const start = (name: string) => (poses.get(name) ?? IDENTITY).translation;
  const end = (name: string) => transformPoint(poses.get(name) ?? IDENTITY, { x: 0, y: 0, z: lengthOf(name) });
  const fingers = ["finger_left", "finger_right"].map((name): [Vector, Vector] => [start(name), end(name)]);
  return { chain: [...["shoulder_pan", "shoulder_lift", "elbow", "wrist"].map(start), end("wrist")], fingers };
}
