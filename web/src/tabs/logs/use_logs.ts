/** The tail of `/rosout`, from the run's history on. It is collected from the first time that this tab is shown, also while other tabs are shown. */
import { useEffect, useSyncExternalStore } from "react";
import { useConsole } from "@/api/console_store";
import { getJson } from "@/api/http";
import { TOPICS } from "@/generated/graph";
import type { rcl_interfaces_Log as Log } from "@/generated/messages";
import { topics } from "@/robot/link";
import { LogStore, type Tail } from "./log_store";

/** In a flood of messages every row changes. This period is short enough to follow, and leaves time for the rest of the page. */
const PERIOD_MS = 60;

export const LOGS = new LogStore((flush) => setTimeout(() => requestAnimationFrame(flush), PERIOD_MS));

/** Messages that the server queues for a slow link. */
const OPTIONS = { queueLength: 500 };

let followed = "";
let endFollowing = () => {};

function follow(topic: string): void {
  if (followed === topic) return;
  endFollowing();
  followed = topic;
  const row = { name: topic, type: TOPICS.ROSOUT.type };
  const endPast = topic === TOPICS.ROSOUT.name ? followPast() : () => {};
  const endLive = topics.listen(row, OPTIONS, () => {
    const sample = topics.last(row, OPTIONS);
    if (sample !== undefined) LOGS.add(sample.message, sample.receivedMs);
  });
  endFollowing = () => {
    endPast();
    endLive();
  };
}

/** Take what was logged before, and again after every outage. */
function followPast(): () => void {
  // Without the history, the log begins with this page.
  const load = () => getJson<Partial<Log>[]>("/_api/history/log").then((lines) => LOGS.addPast(lines), () => {});
  void load();
  return useConsole.subscribe((state, before) => {
    if (state.online && !before.online) void load();
  });
}

export function useLogTail(topic: string): Tail {
  useEffect(() => follow(topic), [topic]);
  return useSyncExternalStore(LOGS.subscribe, () => LOGS.tail);
}
