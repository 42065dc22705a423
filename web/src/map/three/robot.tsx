/** The robot in its greenhouse: it stands where the transforms say, with its arm as the joints say. */
import { useRef } from "react";
import { DoubleSide, type Group, Vector3 } from "three";
import { TOPICS } from "@/generated/graph";
import { useSamples } from "@/hooks/use_topic";
import { liveMap } from "@/map/live_map";
import { useSetting } from "@/state/settings";
import { RobotModel, poseJoints } from "./robot_model";
import { useLiveUpdate } from "./use_live";

const JOINTS_THROTTLE_MS = 100;
const UP = new Vector3(0, 0, 1);

export function Robot({ color, isStopped, isStale }: { color: string; isStopped: boolean; isStale: boolean }) {
  const place = useRef<Group>(null);
  const joints = useRef(new Map<string, Group>());
  const topic = useSetting("jointStatesTopic");
  useSamples(
    { name: topic, type: TOPICS.JOINT_STATES.type },
    ({ message, receivedMs }) => liveMap.takeJoints(message.name, message.position, receivedMs),
    { throttleMs: JOINTS_THROTTLE_MS },
  );
  useLiveUpdate(["joints"], () => poseJoints(joints.current, liveMap.joints));
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
      <RobotModel joints={joints} {...(isStale ? { color: "#83938a", opacity: 0.55 } : {})} />
      <mesh position={[0, 0, 0.006]} renderOrder={6}>
        <ringGeometry args={[0.345, isStopped ? 0.385 : 0.365, 56]} />
        <meshBasicMaterial color={color} side={DoubleSide} transparent opacity={isStale ? 0.5 : 1} depthWrite={false} />
      </mesh>
      <mesh position={[0, 0, 0.005]} renderOrder={5}>
        <circleGeometry args={[0.345, 40]} />
        <meshBasicMaterial color={color} transparent opacity={0.12} depthWrite={false} />
      </mesh>
      <mesh position={[0.43, 0, 0.006]} rotation={[0, 0, -Math.PI / 2]} renderOrder={6}>
        <circleGeometry args={[0.075, 3, Math.PI / 2]} />
        <meshBasicMaterial color={color} transparent opacity={isStale ? 0.5 : 1} depthWrite={false} />
      </mesh>
    </group>
  );
}
