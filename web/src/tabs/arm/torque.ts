/**
 * The torque as this tab knows it, which enables its sliders.
 *
 * It is unknown whenever the tab is opened: torque that another browser or an earlier visit switched on does not enable the
 * sliders here. Only switching it on from this tab, confirmed by the robot, enables them; any sign that the arm has been limp
 * since then disables them.
 */
import type { TextKey } from "@/i18n/text";
import type { Reason } from "@/state/can_drive";

/** True: switched on from this tab and confirmed. False: the arm is limp. Null: unknown. */
export type Torque = boolean | null;

export type TorqueEvent =
  | { kind: "confirmed"; on: boolean }
  /** Switching failed, possibly half way, so the torque is unknown. */
  | { kind: "failed" }
  /** The arm's library reports the torque five times a second. False is certain; it also reports true before the first switching. */
  | { kind: "reported"; on: boolean }
  | { kind: "link-lost" };

export function nextTorque(torque: Torque, event: TorqueEvent): Torque {
  switch (event.kind) {
    case "confirmed":
      return event.on;
    case "failed":
    case "link-lost":
      return null;
    case "reported":
      if (!event.on) return false;
      return torque === false ? null : torque;
  }
}

const AGAINST_SWITCHING: readonly TextKey[] = ["why_no_link", "why_other_tab", "why_viewer", "why_control", "arm_why_calibrating"];

/**
 * Why the torque cannot be switched now, of what keeps the arm from moving. As the robot judges it: a stop keeps a stiff arm
 * stiff, since it would sink, and lets a limp one be enabled, which holds it where it is. No gate of this page is asked.
 */
export function torqueObstacles(obstacles: readonly Reason[], on: boolean): Reason[] {
  return obstacles.filter(({ key }) => AGAINST_SWITCHING.includes(key) || (!on && key === "why_estop"));
}
