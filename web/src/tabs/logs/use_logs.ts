/** The tail of `/rosout`. It is collected from the first time that this tab is shown, also while other tabs are shown. */
import { useEffect, useSyncExternalStore } from "react";
import { TOPICS } from "@/generated/graph";
import { topics } from "@/robot";
import { LogStore, MAX_ROWS, type Tail } from "./log_store";

/** In a flood of messages every row changes. This period is short enough to follow, and leaves time for the rest of the page. */
const PERIOD_MS = 60;

export const LOGS = new LogStore((flush) => setTimeout(() => requestAnimationFrame(flush), PERIOD_MS));

/** Messages that the server queues for a slow link; more than are kept here would be useless. */
const OPTIONS = { queueLength: MAX_ROWS };

let followed = "";
let endFollowing = () => {};

function follow(topic: string): void {
  if (followed === topic) return;
  endFollowing();
  followed = topic;
  const row = { name: topic, type: TOPICS.ROSOUT.type };
  endFollowing = topics.listen(row, OPTIONS, () => {
    const sample = topics.last(row, OPTIONS);
    if (sample !== undefined) LOGS.add(sample.message, sample.receivedMs);
  });
}

export function useLogTail(topic: string): Tail {
  useEffect(() => follow(topic), [topic]);
  return useSyncExternalStore(LOGS.subscribe, () => LOGS.tail);
}
