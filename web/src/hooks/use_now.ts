import { createContext, useContext, useSyncExternalStore } from "react";

const PERIOD_MS = 250;

/** What a view takes for now: the page's time, or that of the moment of a recording which it shows. */
export interface Clock {
  subscribe: (changed: () => void) => () => void;
  /** ms, on the scale of performance.now(). */
  now: () => number;
}

let now = performance.now();
const listeners = new Set<() => void>();
let timer: ReturnType<typeof setInterval> | undefined;

function subscribe(changed: () => void): () => void {
  listeners.add(changed);
  timer ??= setInterval(() => {
    now = performance.now();
    for (const listener of listeners) listener();
  }, PERIOD_MS);
  return () => {
    listeners.delete(changed);
    if (listeners.size === 0) {
      clearInterval(timer);
      timer = undefined;
    }
  };
}

export const LIVE_CLOCK: Clock = { subscribe, now: () => now };
export const ClockContext = createContext(LIVE_CLOCK);

/** The clock's time: that of the page comes four times a second, for ages. */
export function useNow(): number {
  const clock = useContext(ClockContext);
  return useSyncExternalStore(clock.subscribe, clock.now);
}

/** The age in seconds of something that happened at `atMs`; null where it never did. */
export function useAge(atMs: number | null | undefined): number | null {
  const current = useNow();
  return atMs === null || atMs === undefined ? null : Math.max(0, (current - atMs) / 1000);
}

/** What is derived from the clock's time; the component renders only when it changes. */
export function useTimeValue<Value extends string | number | boolean | null>(derive: (nowMs: number) => Value): Value {
  const clock = useContext(ClockContext);
  return useSyncExternalStore(clock.subscribe, () => derive(clock.now()));
}
