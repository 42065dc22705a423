// @vitest-environment jsdom
import { beforeEach, describe, expect, it, vi } from "vitest";
import { followTabs, isWatching, takeOverTab, useTabRole } from "./commanding_tab";

type Granted = (lock: Lock | null) => unknown;

/** A lock manager with one other tab, which may hold the lock. */
class OtherTab {
  isHeld = false;
  private queue: Granted[] = [];
  private lose: ((error: Error) => void) | null = null;

  readonly locks = {
    request: (_name: string, options: LockOptions, granted: Granted) =>
      new Promise((resolve, reject) => {
        const grant = () => {
          this.lose = reject;
          void granted({} as Lock);
        };
        if (options.steal === true || !this.isHeld) {
          this.isHeld = false;
          grant();
        } else if (options.ifAvailable === true) resolve(granted(null));
        else {
          this.queue.push(grant);
          options.signal?.addEventListener("abort", () => {
            this.queue = this.queue.filter((each) => each !== grant);
            reject(new DOMException("aborted", "AbortError"));
          });
        }
      }),
  } as unknown as LockManager;

  close(): void {
    this.isHeld = false;
    this.queue.shift()?.({} as Lock);
  }

  steal(): void {
    this.isHeld = true;
    this.lose?.(new DOMException("stolen", "AbortError"));
  }

  get waiting(): number {
    return this.queue.length;
  }
}

const settled = () => new Promise((resolve) => setTimeout(resolve, 0));

describe("of the tabs of a browser", () => {
  let other: OtherTab;

  beforeEach(() => {
    useTabRole.setState({ role: "unknown" });
    other = new OtherTab();
  });

  it("the first commands", async () => {
    followTabs(other.locks);
    await settled();
    expect(useTabRole.getState().role).toBe("commanding");
  });

  it("the second watches, and commands once the first is closed", async () => {
    other.isHeld = true;
    followTabs(other.locks);
    await settled();
    expect(isWatching()).toBe(true);
    other.close();
    await settled();
    expect(useTabRole.getState().role).toBe("commanding");
  });

  it("one takes over, and waits again after it was taken over from", async () => {
    other.isHeld = true;
    followTabs(other.locks);
    await settled();
    takeOverTab();
    await settled();
    expect([useTabRole.getState().role, other.waiting]).toEqual(["commanding", 0]);
    other.steal();
    await settled();
    expect([isWatching(), other.waiting]).toEqual([true, 1]);
    other.close();
    await settled();
    expect(isWatching()).toBe(false);
  });

  it("one commands also where there are no locks", async () => {
    const posted: string[] = [];
    const channels: { onmessage: ((event: { data: string }) => void) | null }[] = [];
    vi.stubGlobal(
      "BroadcastChannel",
      class {
        onmessage: ((event: { data: string }) => void) | null = null;
        constructor() {
          channels.push(this);
        }
        postMessage(data: string): void {
          posted.push(data);
        }
      },
    );
    vi.useFakeTimers();
    followTabs(undefined);
    vi.advanceTimersByTime(1000);
    expect([useTabRole.getState().role, posted]).toEqual(["commanding", ["asks", "commands"]]);
    channels[0]?.onmessage?.({ data: "commands" });
    expect(isWatching()).toBe(true);
    channels[0]?.onmessage?.({ data: "leaves" });
    vi.advanceTimersByTime(1000);
    expect(isWatching()).toBe(false);
    vi.useRealTimers();
  });
});
