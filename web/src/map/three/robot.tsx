/** The robot in its greenhouse: it stands where the transforms say, with its arm as the joints say. */
import { useRef } from "react";
import { DoubleSide, type Group, type Mesh, Vector3 } from "three";
import { TOPICS } from "@/generated/graph";
import { useSamples } from "@/hooks/use_topic";
import { RING_M } from "@/map/draw/ink";
import { liveMap } from "@/map/live_map";
import { useSetting } from "@/state/settings";
import { RobotModel, poseBodies } from "./robot_model";
import { useLiveUpdate } from "./use_live";

const JOINTS_THROTTLE_MS = 100;
const UP = new Vector3(0, 0, 1);
const INSIDE_M = RING_M - 0.015;

export function Robot({ color, isStopped, isStale }: { color: string; isStopped: boolean; isStale: boolean }) {
  const place = useRef<Group>(null);
  const meshes = useRef(new Map<string, Mesh>());
  const topic = useSetting("jointStatesTopic");
  useSamples(
    { name: topic, type: TOPICS.JOINT_STATES.type },
    ({ message, receivedMs }) => liveMap.takeJoints(message.name, message.position, receivedMs),
    { throttleMs: JOINTS_THROTTLE_MS },
  );
  useLiveUpdate(["joints"], () => poseBodies(meshes.current, liveMap.joints));
  useLiveUpdate(["motion"], () => {
    const { pose } = liveMap;
    if (place.current === null) return;
    place.current.visible = pose !== null;
    if (pose === null) return;
    place.current.position.set(pose.x, pose.y, 0);
    place.current.quaternion.setFromAxisAngle(UP, pose.yaw);
  });
  return (
    <group ref={place} visible={false}>
      <RobotModel meshes={meshes} {...(isStale ? { color, opacity: 0.55 } : {})} />
      <mesh position={[0, 0, 0.006]} renderOrder={6}>
        <ringGeometry args={[INSIDE_M, RING_M + (isStopped ? 0.025 : 0.005), 56]} />
        <meshBasicMaterial color={color} side={DoubleSide} transparent opacity={isStale ? 0.5 : 1} depthWrite={false} />
      </mesh>
      <mesh position={[0, 0, 0.005]} renderOrder={5}>
        <circleGeometry args={[INSIDE_M, 40]} />
        <meshBasicMaterial color={color} transparent opacity={0.12} depthWrite={false} />
      </mesh>
      <mesh position={[0.43, 0, 0.006]} rotation={[0, 0, -Math.PI / 2]} renderOrder={6}>
        <circleGeometry args={[0.075, 3, Math.PI / 2]} />
        <meshBasicMaterial color={color} transparent opacity={isStale ? 0.5 : 1} depthWrite={false} />
      </mesh>
    </group>
  );
}
