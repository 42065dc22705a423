import { createContext, useCallback, useContext, useEffect, useRef, useSyncExternalStore } from "react";
import type { MessageTypes } from "@/generated/messages";
import type { SubscribeOptions } from "@/ros/rosbridge";
import type { Sample, TopicRow, TopicStore } from "@/ros/topics";
import { topics } from "@/robot/link";

/** Where views take their samples from: the robot, unless they show the past. */
export const TopicsContext = createContext<TopicStore>(topics);

export function useTopics(): TopicStore {
  return useContext(TopicsContext);
}

/** The last sample of a topic, redrawn once per frame at most. */
export function useTopic<Type extends keyof MessageTypes>(
  row: TopicRow<Type>,
  options: SubscribeOptions = {},
): Sample<MessageTypes[Type]> | undefined {
  const { name, type } = row;
  const { throttleMs, queueLength } = options;
  const store = useTopics();
  const shown = useRef<Sample<MessageTypes[Type]> | undefined>(undefined);
  const subscribe = useCallback(
    (changed: () => void) => {
      const wanted = subscribeOptions(throttleMs, queueLength);
      let frame = 0;
      const end = store.listen({ name, type }, wanted, () => {
        frame ||= requestAnimationFrame(() => {
          frame = 0;
          shown.current = store.last({ name, type }, wanted);
          changed();
        });
      });
      shown.current = store.last({ name, type }, wanted);
      return () => {
        cancelAnimationFrame(frame);
        end();
      };
    },
    [store, name, type, throttleMs, queueLength],
  );
  return useSyncExternalStore(subscribe, () => shown.current);
}

/** Call `take` with every sample, for what draws without React. `take` may be another function at every render. */
export function useSamples<Type extends keyof MessageTypes>(
  row: TopicRow<Type>,
  take: (sample: Sample<MessageTypes[Type]>) => void,
  options: SubscribeOptions = {},
): void {
  const { name, type } = row;
  const { throttleMs, queueLength } = options;
  const store = useTopics();
  const current = useRef(take);
  useEffect(() => {
    current.current = take;
  });
  useEffect(() => {
    const wanted = subscribeOptions(throttleMs, queueLength);
    const pass = () => {
      const sample = store.last<Type>({ name, type }, wanted);
      if (sample !== undefined) current.current(sample);
    };
    const end = store.listen({ name, type }, wanted, pass);
    pass();
    return end;
  }, [store, name, type, throttleMs, queueLength]);
}

function subscribeOptions(throttleMs: number | undefined, queueLength: number | undefined): SubscribeOptions {
  return { ...(throttleMs === undefined ? {} : { throttleMs }), ...(queueLength === undefined ? {} : { queueLength }) };
}
