/**
 * Which page of this browser commands.
 *
 * All tabs and windows of a browser are one session of the server, which cannot tell them apart: two that both command would
 * hold the wheels against each other. So one of them has a lock and commands; the others watch, and can stop and take over.
 * The lock passes on when its tab closes or crashes.
 */
import { create } from "zustand";

export type TabRole = "unknown" | "commanding" | "watching";

export const useTabRole = create<{ role: TabRole }>(() => ({ role: "unknown" }));

/** Whether another tab of this browser commands. */
export function isWatching(): boolean {
  return useTabRole.getState().role === "watching";
}

const NAME = "lupin-commanding-tab";

function setRole(role: TabRole): void {
  if (useTabRole.getState().role !== role) useTabRole.setState({ role });
}

let waiting: AbortController | null = null;
let take = () => setRole("commanding");

/** Compete for the lock of this browser, for as long as the page is open. */
export function followTabs(locks: LockManager | undefined = navigator.locks): void {
  if (locks === undefined) {
    // Over plain HTTP from another computer, browsers have no locks.
    take = followChannel();
    return;
  }
  take = () => {
    waiting?.abort();
    request(locks, { steal: true });
  };
  request(locks, { ifAvailable: true });
}

/** Command from this tab from now on; the one that did watches. */
export function takeOverTab(): void {
  take();
}

function request(locks: LockManager, options: LockOptions): void {
  const held = locks.request(NAME, options, (lock) => {
    if (lock === null) return undefined;
    setRole("commanding");
    return new Promise<void>(() => {});
  });
  held.then(
    () => wait(locks),
    (error: unknown) => {
      if (options.signal?.aborted === true) return; // this tab takes the lock instead of waiting for it
      if (error instanceof DOMException && error.name === "AbortError") wait(locks); // another tab took it
      else take = followChannel();
    },
  );
}

function wait(locks: LockManager): void {
  setRole("watching");
  waiting = new AbortController();
  request(locks, { signal: waiting.signal });
}

const ANSWER_MS = 300;

/** Without locks, the tabs agree by messages: whoever commanded last does. */
function followChannel(): () => void {
  const channel = new BroadcastChannel(NAME);
  const command = () => {
    clearTimeout(timer);
    setRole("commanding");
    channel.postMessage("commands");
  };
  const askOthers = () => {
    clearTimeout(timer);
    channel.postMessage("asks");
    timer = setTimeout(command, ANSWER_MS * (1 + Math.random()));
  };
  let timer: ReturnType<typeof setTimeout> | undefined;
  channel.onmessage = ({ data }) => {
    if (data === "asks" && useTabRole.getState().role === "commanding") channel.postMessage("commands");
    if (data === "commands") {
      clearTimeout(timer);
      setRole("watching");
    }
    if (data === "leaves") askOthers();
  };
  window.addEventListener("pagehide", () => {
    if (useTabRole.getState().role === "commanding") channel.postMessage("leaves");
  });
  askOthers();
  return command;
}
