/** The robot from the simulator's own dimensions. */
import { type RefObject, useEffect, useMemo } from "react";
import type { Group } from "three";
import { BODIES, type Body, GRIPPER_APERTURE_M } from "@/generated/robot_model";
import { GRIPPER, JOINT_LIMITS } from "@/generated/robot";
import { bodyGeometry, quaternion, vector } from "./body_geometry";

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
  const geometry = useMemo(() => bodyGeometry(body), [body]);
  useEffect(() => () => geometry.dispose(), [geometry]);
  return (
    <group position={vector(body.at)} quaternion={quaternion(body.turned)}>
      <group
        ref={(group) => {
          if (group === null || body.joint === "") return;
          joints.current.set(body.name, group);
        }}
      >
        <mesh geometry={geometry}>
          {/* The shader depends on whether the corners have colors: another material. */}
          <meshLambertMaterial key={color ?? ""} color={color ?? "white"} vertexColors={color === undefined} transparent={opacity < 1} opacity={opacity} />
        </mesh>
        {BODIES.filter((child) => child.parent === body.name).map((child) => (
          <BodyGroup key={child.name} body={child} joints={joints} opacity={opacity} {...(color === undefined ? {} : { color })} />
        ))}
      </group>
    </group>
  );
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
