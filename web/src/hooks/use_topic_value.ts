import { useCallback, useRef, useSyncExternalStore } from "react";
import type { MessageTypes } from "@/generated/messages";
import type { Sample, TopicRow } from "@/ros/topics";
import { useTopics } from "./use_topic";

/**
 * What `select` takes from the last sample of a topic. The component renders only when that changes, by a comparison of its
 * fields: a state that comes five times a second changes far less often.
 */
export function useTopicValue<Type extends keyof MessageTypes, Value>(
  row: TopicRow<Type>,
  select: (sample: Sample<MessageTypes[Type]> | undefined) => Value,
): Value {
  const { name, type } = row;
  const store = useTopics();
  const shown = useRef<{ value: Value } | null>(null);
  const subscribe = useCallback((changed: () => void) => store.listen({ name, type }, {}, changed), [store, name, type]);
  return useSyncExternalStore(subscribe, () => {
    const value = select(store.last<Type>({ name, type }));
    if (shown.current === null || !isSame(shown.current.value, value)) shown.current = { value };
    return shown.current.value;
  });
}

/** Whether two values, or all fields of two objects, are equal. */
export function isSame(a: unknown, b: unknown): boolean {
  if (Object.is(a, b)) return true;
  if (typeof a !== "object" || typeof b !== "object" || a === null || b === null) return false;
  const [fieldsA, fieldsB] = [Object.entries(a), Object.entries(b)];
  return fieldsA.length === fieldsB.length && fieldsA.every(([name, value]) => Object.is(value, (b as Record<string, unknown>)[name]));
}
