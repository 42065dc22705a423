/** The robot from the simulator's own dimensions. */
import type { RefObject } from "react";
import { type Group, Quaternion, Vector3 } from "three";
import { BODIES, type Body, GRIPPER_APERTURE_M, type Shape } from "@/generated/robot_model";
import { GRIPPER, JOINT_LIMITS } from "@/generated/robot";

const GRIPPER_JOINT = "gripper_joint" satisfies keyof typeof JOINT_LIMITS;

export type JointGroups = RefObject<Map<string, Group>>;

interface RobotModelProps {
  joints: JointGroups;
  /** Instead of the model's own colors, as for a ghost. */
  color?: string;
  opacity?: number;
}

/** Base, arm and gripper; `poseJoints` moves them. */
export function RobotModel({ joints, color, opacity = 1 }: RobotModelProps) {
  const root = BODIES.find((body) => body.parent === "");
  return root === undefined ? null : <BodyGroup body={root} joints={joints} opacity={opacity} {...(color === undefined ? {} : { color })} />;
}

function BodyGroup({ body, joints, color, opacity }: { body: Body; joints: JointGroups; color?: string; opacity: number }) {
  return (
    <group position={vector(body.at)} quaternion={quaternion(body.turned)}>
      <group
        ref={(group) => {
          if (group === null || body.joint === "") return;
          joints.current.set(body.name, group);
        }}
      >
        {body.shapes.map((shape, index) => (
          <ShapeMesh key={index} shape={shape} opacity={opacity} {...(color === undefined ? {} : { color })} />
        ))}
        {BODIES.filter((child) => child.parent === body.name).map((child) => (
          <BodyGroup key={child.name} body={child} joints={joints} opacity={opacity} {...(color === undefined ? {} : { color })} />
        ))}
      </group>
    </group>
  );
}

function ShapeMesh({ shape, color, opacity }: { shape: Shape; color?: string; opacity: number }) {
  const [a = 0, b = 0, c = 0] = shape.size;
  const [red = 0, green = 0, blue = 0] = shape.color;
  return (
    <group position={vector(shape.at)} quaternion={quaternion(shape.turned)}>
      {/* MuJoCo's cylinders stand along z, with half their length; those of three.js along y. */}
      <mesh {...(shape.kind === "cylinder" ? { rotation: [Math.PI / 2, 0, 0] as const } : {})}>
        {shape.kind === "box" ? <boxGeometry args={[2 * a, 2 * b, 2 * c]} /> : <cylinderGeometry args={[a, a, 2 * b, 20]} />}
        <meshLambertMaterial color={color ?? `rgb(${[red, green, blue].map((value) => Math.round(value * 255)).join(",")})`} transparent={opacity < 1} opacity={opacity} />
      </mesh>
    </group>
  );
}

function vector([x = 0, y = 0, z = 0]: number[]): Vector3 {
  return new Vector3(x, y, z);
}

function quaternion([x = 0, y = 0, z = 0, w = 1]: number[]): Quaternion {
  return new Quaternion(x, y, z, w);
}

/** How far each finger stands from the middle of the gripper, m, at a position of its joint. */
export function fingerOffset(gripperRad: number): number {
  const [openM, closedM] = GRIPPER_APERTURE_M;
  const share = (gripperRad - GRIPPER.openRad) / (GRIPPER.closedRad - GRIPPER.openRad);
  return (openM + (closedM - openM) * Math.min(1, Math.max(0, share))) / 2;
}

/** Move the joints of a model to positions by name, rad. */
export function poseJoints(groups: ReadonlyMap<string, Group>, positions: ReadonlyMap<string, number>): void {
  for (const body of BODIES) {
    const group = groups.get(body.name);
    if (group === undefined) continue;
    const axis = vector(body.axis);
    if (body.slides) {
      const gripper = positions.get(GRIPPER_JOINT);
      if (gripper !== undefined) group.position.copy(axis.multiplyScalar(fingerOffset(gripper)));
      continue;
    }
    const position = positions.get(body.joint);
    if (position !== undefined) group.quaternion.setFromAxisAngle(axis, position);
  }
}
