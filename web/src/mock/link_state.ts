/** When the link is lost or samples cease, in the mock states that show this. */
import type { MockOptions } from "./options";

/** How long everything works first, so that there is data which can become outdated. */
const WORKS_MS = 3000;

const beganMs = performance.now();

export function isLost({ state }: MockOptions): boolean {
  return state === "lost" && performance.now() - beganMs > WORKS_MS;
}

export function isSilent({ state }: MockOptions): boolean {
  return state === "stale" && performance.now() - beganMs > WORKS_MS;
}

/** Call `act` when the link is lost; never in the states in which it is not. */
export function whenLost({ state }: MockOptions, act: () => void): void {
  if (state === "lost") setTimeout(act, Math.max(0, beganMs + WORKS_MS - performance.now()));
}
