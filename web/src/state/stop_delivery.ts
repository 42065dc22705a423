/** How far a stop has come, as far as this page knows: no more than that is shown. */

export type StopDelivery =
  /** Nothing asks for a stop. */
  | "ready"
  /** A stop was asked for; the robot has not confirmed it. */
  | "sent"
  /** The robot says that it is stopped. */
  | "stopped"
  /** A stop was asked for, and could not be sent. */
  | "unsent"
  /** A stop was sent, and should have been confirmed by now. */
  | "unconfirmed";

/** The robot repeats its state five times a second, so a stop that it heard is confirmed long before. */
export const CONFIRMED_WITHIN_MS = 2000;

export interface DeliveryFacts {
  linkOpen: boolean;
  /** The robot's own e-stop; null where it is not known. */
  robotStopped: boolean | null;
  /** The console's server says that it holds a stop. */
  serverStops: boolean;
  /** This page asks for a stop. */
  isStated: boolean;
  /** The last stop of this page was handed to the link, or the server has answered it. */
  wasSent: boolean;
  /** How long the stop has been asked for; null where this page does not ask for it. */
  ageMs: number | null;
}

export function stopDelivery({ linkOpen, robotStopped, serverStops, isStated, wasSent, ageMs }: DeliveryFacts): StopDelivery {
  if (robotStopped === true) return "stopped";
  if (!isStated) return linkOpen && serverStops ? "sent" : "ready";
  if (!wasSent && !serverStops) return "unsent";
  return ageMs !== null && ageMs > CONFIRMED_WITHIN_MS ? "unconfirmed" : "sent";
}
