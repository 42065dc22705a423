/** Runs the timers of a page in a thread of their own, which browsers do not slow down while the page is hidden. */

export interface TimerRequest {
  id: number;
  /** Milliseconds; null ends the timer. */
  periodMs: number | null;
}

const timers = new Map<number, ReturnType<typeof setInterval>>();

self.onmessage = ({ data: { id, periodMs } }: MessageEvent<TimerRequest>) => {
  clearInterval(timers.get(id));
  timers.delete(id);
  if (periodMs !== null) timers.set(id, setInterval(() => self.postMessage(id), periodMs));
};
self.postMessage(0);
