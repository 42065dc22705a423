import { useSyncExternalStore } from "react";

const PERIOD_MS = 250;

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

/** performance.now(), four times a second: for ages. */
export function useNow(): number {
  return useSyncExternalStore(subscribe, () => now);
}

/** The age in seconds of something that happened at `atMs`; null where it never did. */
export function useAge(atMs: number | null | undefined): number | null {
  const current = useNow();
  return atMs === null || atMs === undefined ? null : Math.max(0, (current - atMs) / 1000);
}

/** What is derived from performance.now(), looked at four times a second; the component renders only when it changes. */
export function useTimeValue<Value extends string | number | boolean | null>(derive: (nowMs: number) => Value): Value {
  return useSyncExternalStore(subscribe, () => derive(now));
}
