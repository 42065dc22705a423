/** Where the robot's bodies are for given joint angles: rigid transforms along the tree of the simulator's model. */
import { JOINTS } from "@/generated/graph";
import { BODIES, GRIPPER_APERTURE_M } from "@/generated/robot_model";
import { toRadians } from "@/ui/numbers";
import { type Angles, type JointName, gripperClosedShare } from "./joints";

export type Point = readonly [x: number, y: number, z: number];
type Quaternion = readonly [x: number, y: number, z: number, w: number];

export interface Frame {
  at: Point;
  turned: Quaternion;
}

export function rotate([qx, qy, qz, qw]: Quaternion, [x, y, z]: Point): Point {
  // v + 2w(q x v) + 2q x (q x v)
  const tx = 2 * (qy * z - qz * y);
  const ty = 2 * (qz * x - qx * z);
  const tz = 2 * (qx * y - qy * x);
  return [x + qw * tx + qy * tz - qz * ty, y + qw * ty + qz * tx - qx * tz, z + qw * tz + qx * ty - qy * tx];
}

function multiply([ax, ay, az, aw]: Quaternion, [bx, by, bz, bw]: Quaternion): Quaternion {
  return [
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
    aw * bw - ax * bx - ay * by - az * bz,
  ];
}

export function transform(frame: Frame, point: Point): Point {
  const [x, y, z] = rotate(frame.turned, point);
  return [frame.at[0] + x, frame.at[1] + y, frame.at[2] + z];
}

export function compose(parent: Frame, child: Frame): Frame {
  return { at: transform(parent, child.at), turned: multiply(parent.turned, child.turned) };
}

export function frameOf(at: readonly number[], turned: readonly number[]): Frame {
  const [x = 0, y = 0, z = 0] = at;
  const [qx = 0, qy = 0, qz = 0, qw = 1] = turned;
  return { at: [x, y, z], turned: [qx, qy, qz, qw] };
}

/** The pose of a joint's axis: a turn about it in rad, or a slide along it in m. */
function jointFrame(axis: readonly number[], value: number, slides: boolean): Frame {
  const [x = 0, y = 0, z = 0] = axis;
  if (slides) return { at: [x * value, y * value, z * value], turned: [0, 0, 0, 1] };
  const sine = Math.sin(value / 2);
  return { at: [0, 0, 0], turned: [x * sine, y * sine, z * sine, Math.cos(value / 2)] };
}

/** Half of the gap between the fingers, m. */
function fingerOffset(angles: Angles): number {
  const [open, closed] = GRIPPER_APERTURE_M;
  const share = gripperClosedShare(angles[JOINTS.gripper] ?? 0);
  return (open + share * (closed - open)) / 2;
}

/** The frame of every body by its name, for joint angles in degrees. A joint that is unknown counts as 0. */
export function bodyFrames(angles: Angles): Map<string, Frame> {
  const frames = new Map<string, Frame>();
  for (const body of BODIES) {
    const value = body.slides ? fingerOffset(angles) : toRadians(angles[body.joint as JointName] ?? 0);
    const parent = frames.get(body.parent) ?? frameOf([], []);
    frames.set(body.name, compose(compose(parent, frameOf(body.at, body.turned)), jointFrame(body.axis, value, body.slides)));
  }
  return frames;
}

const FINGER_LENGTH_M = 0.06;

/** The arm as lines: the joints from pan to wrist and the palm, and the two fingers. */
export function skeleton(angles: Angles): { chain: Point[]; fingers: [Point, Point][] } {
  const frames = bodyFrames(angles);
  const at = (body: string) => frames.get(body)?.at ?? [0, 0, 0];
  const palm = transform(frames.get("wrist") ?? frameOf([], []), [0, 0, 0.058]);
  const fingers = ["finger_left", "finger_right"].map((name): [Point, Point] => {
    const frame = frames.get(name) ?? frameOf([], []);
    return [frame.at, transform(frame, [0, 0, FINGER_LENGTH_M])];
  });
  return { chain: [at("shoulder_pan"), at("shoulder_lift"), at("elbow"), at("wrist"), palm], fingers };
}
