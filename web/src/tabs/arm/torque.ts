/**
 * The torque as this tab knows it, which arms its sliders.
 *
 * It is unknown whenever the tab is opened: what another browser or an earlier visit switched on arms nothing here. Only a
 * switch that the robot confirmed to this tab arms it, and every sign that the arm was limp since then disarms it.
 */

/** True: switched on from here and confirmed. False: the arm is limp. Null: unknown. */
export type Torque = boolean | null;

export type TorqueEvent =
  | { kind: "confirmed"; on: boolean }
  /** A switch that failed half way: nobody knows. */
  | { kind: "failed" }
  /** What the arm's library says five times a second: false is certain, true is also said before the first switch. */
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
