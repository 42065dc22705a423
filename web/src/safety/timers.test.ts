import { beforeEach, describe, expect, it, vi } from "vitest";
import type { TimerRequest } from "./timer_worker";
import { Timers } from "./timers";

class FakeWorker {
  onmessage: ((event: MessageEvent) => void) | null = null;
  onerror: ((event: ErrorEvent) => void) | null = null;
  requests: TimerRequest[] = [];
  postMessage(request: TimerRequest): void {
    this.requests.push(request);
  }
  say(id: number): void {
    this.onmessage?.({ data: id } as MessageEvent);
  }
}

describe("timers", () => {
  let worker: FakeWorker;
  let timers: Timers;
  const act = vi.fn<() => void>();

  beforeEach(() => {
    vi.useFakeTimers();
    act.mockClear();
    worker = new FakeWorker();
    timers = new Timers(() => worker);
  });

  it("are the page's own until the worker has started, and the worker's afterwards", () => {
    const end = timers.every(50, act);
    vi.advanceTimersByTime(100);
    expect(act).toHaveBeenCalledTimes(2);
    worker.say(0);
    expect(worker.requests).toEqual([{ id: 1, periodMs: 50 }]);
    vi.advanceTimersByTime(1000);
    expect(act).toHaveBeenCalledTimes(2);
    worker.say(1);
    expect(act).toHaveBeenCalledTimes(3);
    end();
    worker.say(1);
    expect(act).toHaveBeenCalledTimes(3);
    expect(worker.requests.at(-1)).toEqual({ id: 1, periodMs: null });
  });

  it("make up for one of the ticks that a busy page missed", () => {
    worker.say(0);
    timers.every(50, act);
    for (let tick = 0; tick < 40; tick += 1) worker.say(1);
    expect(act).toHaveBeenCalledOnce();
    vi.advanceTimersByTime(50);
    worker.say(1);
    expect(act).toHaveBeenCalledTimes(2);
  });

  it("return to the page when the worker fails", () => {
    worker.say(0);
    timers.every(50, act);
    worker.onerror?.({} as ErrorEvent);
    vi.advanceTimersByTime(100);
    expect(act).toHaveBeenCalledTimes(2);
  });

  it("run once where they shall", () => {
    worker.say(0);
    timers.after(5000, act);
    worker.say(1);
    worker.say(1);
    expect(act).toHaveBeenCalledOnce();
  });

  it("work without a worker", () => {
    const alone = new Timers(() => {
      throw new Error("forbidden");
    });
    alone.every(50, act);
    vi.advanceTimersByTime(100);
    expect(act).toHaveBeenCalledTimes(2);
  });
});
