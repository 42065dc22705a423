/** The tail of `/rosout`, which goes on from the first visit of this tab while other tabs are shown. */
import { useEffect, useSyncExternalStore } from "react";
import { TOPICS } from "@/generated/graph";
import { topics } from "@/robot";
import { LogStore, MAX_ROWS, type Tail } from "./log_store";

/** A flood changes every row of the list: it is redrawn often enough to follow, and leaves time for everything else. */
const PERIOD_MS = 60;

export const LOGS = new LogStore((flush) => setTimeout(() => requestAnimationFrame(flush), PERIOD_MS));

/** What a slow link may let wait: more than is kept here need not come. */
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
