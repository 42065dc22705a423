/** Since when the link to the robot is lost. */
import type { LinkState } from "./rosbridge";

/**
 * When the link was lost, after a change of its state; null while it is not. Attempts to connect do not begin the loss anew, and
 * an open link does not end it: that takes something received.
 */
export function lostSince({ lostMs, wasOpen }: { lostMs: number | null; wasOpen: boolean }, state: LinkState, nowMs: number): number | null {
  return state === "open" || !wasOpen ? lostMs : (lostMs ?? nowMs);
}
