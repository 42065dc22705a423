/** Parts of messages that many samples have. */
import type {
  builtin_interfaces_Time,
  geometry_msgs_Pose,
  geometry_msgs_PoseStamped,
  geometry_msgs_Quaternion,
  geometry_msgs_TransformStamped,
  std_msgs_Header,
} from "@/generated/messages";
import type { Pose2 } from "@/ros/tf";

export function time(seconds: number): builtin_interfaces_Time {
  const sec = Math.floor(seconds);
  return { sec, nanosec: Math.floor((seconds - sec) * 1e9) };
}

export function header(seconds: number, frame: string): std_msgs_Header {
  return { stamp: time(seconds), frame_id: frame };
}

export function quaternion(yaw: number): geometry_msgs_Quaternion {
  return { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) };
}

export function pose({ x, y, yaw }: Pose2, z = 0): geometry_msgs_Pose {
  return { position: { x, y, z }, orientation: quaternion(yaw) };
}

/** A pose that is not known: its orientation is no rotation. */
export const NO_POSE: geometry_msgs_Pose = { position: { x: 0, y: 0, z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 0 } };

export function poseStamped(seconds: number, frame: string, at: Pose2): geometry_msgs_PoseStamped {
  return { header: header(seconds, frame), pose: pose(at) };
}

export function transform(seconds: number, parent: string, child: string, at: Pose2, z = 0): geometry_msgs_TransformStamped {
  return {
    header: header(seconds, parent),
    child_frame_id: child,
    transform: { translation: { x: at.x, y: at.y, z }, rotation: quaternion(at.yaw) },
  };
}

/** A number from -1 to 1 that looks random and depends only on `seed`. */
export function noise(seed: number): number {
  const value = Math.sin(seed * 127.1 + 311.7) * 43758.5453;
  return 2 * (value - Math.floor(value)) - 1;
}
