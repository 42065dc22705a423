/**
 * Timers that go on while the page is hidden.
 *
 * Browsers slow the timers of hidden pages down to one a second, and later to one a minute: the server would take the page for
 * silent, and stop the robot. Those of a worker keep their pace. Until the worker has started, and where there is none, the
 * timers are the page's own.
 */
import type { TimerRequest } from "./timer_worker";

export type EndTimer = () => void;

interface Timer {
  periodMs: number;
  act: () => void;
  /** When the worker's timer acted last (performance.now()). */
  actedMs: number;
  /** The page's own timer; undefined while the worker runs it. */
  own: ReturnType<typeof setInterval> | undefined;
}

type WorkerLike = Pick<Worker, "postMessage" | "onmessage" | "onerror">;

/** The worker's first message, which no timer has. */
const READY = 0;

export class Timers {
  private timers = new Map<number, Timer>();
  private lastId = READY;
  private worker: WorkerLike | null = null;
  private isReady = false;

  constructor(openWorker: () => WorkerLike | null) {
    try {
      this.worker = openWorker();
    } catch {
      return; // forbidden: the page's own timers remain
    }
    if (this.worker === null) return;
    this.worker.onmessage = ({ data }: MessageEvent<number>) => (data === READY ? this.moveToWorker() : this.tick(data));
    this.worker.onerror = () => this.moveToPage();
  }

  /** Call `act` every `periodMs` until the returned function is called. */
  every(periodMs: number, act: () => void): EndTimer {
    this.lastId += 1;
    const id = this.lastId;
    const timer: Timer = { periodMs, act, actedMs: -Infinity, own: undefined };
    this.timers.set(id, timer);
    if (this.isReady) this.request({ id, periodMs });
    else timer.own = setInterval(act, periodMs);
    return () => {
      if (!this.timers.delete(id)) return;
      clearInterval(timer.own);
      if (this.isReady) this.request({ id, periodMs: null });
    };
  }

  /** Call `act` once, after `waitMs`. */
  after(waitMs: number, act: () => void): EndTimer {
    const end = this.every(waitMs, () => {
      end();
      act();
    });
    return end;
  }

  /** Of the ticks that a busy or frozen page missed, one is made up for: what is held now is not sent many times. */
  private tick(id: number): void {
    const timer = this.timers.get(id);
    const nowMs = performance.now();
    if (timer === undefined || nowMs - timer.actedMs < timer.periodMs / 2) return;
    timer.actedMs = nowMs;
    timer.act();
  }

  private request(request: TimerRequest): void {
    this.worker?.postMessage(request);
  }

  private moveToWorker(): void {
    this.isReady = true;
    for (const [id, timer] of this.timers) {
      clearInterval(timer.own);
      timer.own = undefined;
      this.request({ id, periodMs: timer.periodMs });
    }
  }

  private moveToPage(): void {
    this.isReady = false;
    for (const timer of this.timers.values()) timer.own ??= setInterval(timer.act, timer.periodMs);
  }
}

const timers = new Timers(() =>
  typeof Worker === "undefined" ? null : new Worker(new URL("./timer_worker.ts", import.meta.url), { type: "module", name: "timers" }),
);

export const every = (periodMs: number, act: () => void): EndTimer => timers.every(periodMs, act);
export const after = (waitMs: number, act: () => void): EndTimer => timers.after(waitMs, act);
