/** The time of what views show: now, or the moment of the recording. */
import { type Clock, LIVE_CLOCK } from "./use_now";
import { useRewind } from "@/state/rewind";

/** The robot's clock minus performance.now(), s, as it was when the page was rewound. */
let offsetS = 0;

export function setClockOffset(seconds: number): void {
  offsetS = seconds;
}

/** A time of the robot's clock as that of performance.now(). */
export function toPageMs(atS: number): number {
  return (atS - offsetS) * 1000;
}

/** performance.now(), or the time of the moment that views show instead. */
export function viewNow(): number {
  const { shownS } = useRewind.getState();
  return shownS === null ? performance.now() : toPageMs(shownS);
}

export const REWOUND_CLOCK: Clock = {
  subscribe: (changed) => useRewind.subscribe(changed),
  now: () => {
    const { shownS } = useRewind.getState();
    return shownS === null ? LIVE_CLOCK.now() : toPageMs(shownS);
  },
};
