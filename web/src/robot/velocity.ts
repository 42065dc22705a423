/** Velocities as this page publishes them. */
import { type Velocity, isZero } from "@/safety/drive";
import { noteVelocity } from "@/state/publish_log";
import { setting } from "@/state/settings";
import { link } from "./link";

function twist({ x, y, yaw }: Velocity) {
  const sign = setting("polarityInvertHmi") ? -1 : 1;
  return { linear: { x: sign * x, y: sign * y, z: 0 }, angular: { x: 0, y: 0, z: yaw } };
}

/** Publish a velocity on the topic and with the type of the settings. */
export function sendVelocity(velocity: Velocity): void {
  const name = setting("cmdVelTopic");
  const isStamped = setting("cmdVelType") === "geometry_msgs/msg/TwistStamped";
  const sent = isStamped
    ? link.publish(name, "geometry_msgs/msg/TwistStamped", { header: { frame_id: setting("baseFrame") }, twist: twist(velocity) })
    : link.publish(name, "geometry_msgs/msg/Twist", twist(velocity));
  noteVelocity(name, twist(velocity), !isZero(velocity), sent);
}
