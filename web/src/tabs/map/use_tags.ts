import { useMemo } from "react";
import { TOPICS } from "@/generated/graph";
import { useTimeValue } from "@/hooks/use_now";
import { useTopic } from "@/hooks/use_topic";
import { TWIN_STALE_MS, type Tag, readTwin } from "@/map/twin";

interface Twin {
  tags: Tag[];
  /** performance.now() when the last message arrived; the ages in it have grown since. Null before the first message. */
  receivedMs: number | null;
  isStale: boolean;
}

/** The tags of the digital twin. */
export function useTwin(): Twin {
  const sample = useTopic(TOPICS.TWIN_STATE);
  const tags = useMemo(() => (sample === undefined ? [] : readTwin(sample.message)), [sample]);
  const receivedMs = sample?.receivedMs ?? null;
  const isStale = useTimeValue((now) => receivedMs !== null && now - receivedMs > TWIN_STALE_MS);
  return { tags, receivedMs, isStale };
}

/** A tag's age as text, which keeps counting between messages. */
export function useAgeText(ageS: number | null, receivedMs: number | null, write: (seconds: number) => string, unknown: string): string {
  return useTimeValue((now) => (ageS === null || receivedMs === null ? unknown : write(ageS + Math.max(0, now - receivedMs) / 1000)));
}
