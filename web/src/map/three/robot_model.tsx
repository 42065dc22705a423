/** The robot's model as meshes: base, arm and gripper. */
import { type RefObject, useEffect, useMemo } from "react";
import type { Mesh } from "three";
import { BODIES, type Body, bodyPoses } from "@/robot/model";
import { bodyGeometry } from "./body_geometry";

interface RobotModelProps {
  /** The mesh of each body by its name, for `poseBodies`. */
  meshes: RefObject<Map<string, Mesh>>;
  /** Instead of the model's own colors, as for a ghost. */
  color?: string;
  opacity?: number;
}

export function RobotModel(style: RobotModelProps) {
  return BODIES.map((body) => <BodyMesh key={body.name} body={body} {...style} />);
}

function BodyMesh({ body, meshes, color, opacity = 1 }: RobotModelProps & { body: Body }) {
  const geometry = useMemo(() => bodyGeometry(body), [body]);
  useEffect(() => () => geometry.dispose(), [geometry]);
  return (
    <mesh
      geometry={geometry}
      ref={(mesh) => {
        if (mesh !== null) meshes.current.set(body.name, mesh);
      }}
    >
      {/* The shader depends on whether the corners have colors: another material. */}
      <meshLambertMaterial key={color ?? ""} color={color ?? "white"} vertexColors={color === undefined} transparent={opacity < 1} opacity={opacity} />
    </mesh>
  );
}

/** Move the bodies to where they are for positions of the joints by name, rad. */
export function poseBodies(meshes: ReadonlyMap<string, Mesh>, positions: ReadonlyMap<string, number>): void {
  for (const [name, { translation, rotation }] of bodyPoses(positions)) {
    const mesh = meshes.get(name);
    mesh?.position.copy(translation);
    mesh?.quaternion.copy(rotation);
  }
}
