/** Collects the short histories of the readings. */
import { useEffect, useState } from "react";
import { TOPICS } from "@/generated/graph";
import type { MessageTypes } from "@/generated/messages";
import { useSamples } from "@/hooks/use_topic";
import { topics, useLink } from "@/robot/link";
import type { SubscribeOptions } from "@/ros/rosbridge";
import type { TopicRow } from "@/ros/topics";
import { TimeSeries } from "@/widgets/time_series";

const MINUTE_S = 60;
const SAMPLES_A_MINUTE = 1500;

/** The last minute of a value of a topic. */
export function useLastMinute<Type extends keyof MessageTypes>(
  row: TopicRow<Type>,
  pick: (message: MessageTypes[Type]) => number,
  options: SubscribeOptions = {},
): TimeSeries {
  const [series] = useState(() => new TimeSeries(MINUTE_S, SAMPLES_A_MINUTE));
  useSamples(row, ({ message, receivedMs }) => series.push(receivedMs / 1000, pick(message)), options);
  return series;
}

/** The last round trips to the server, ms. */
export function useRoundTrips(): TimeSeries {
  const [series] = useState(() => new TimeSeries(MINUTE_S, SAMPLES_A_MINUTE));
  useEffect(
    () =>
      useLink.subscribe(({ roundTripMs }, before) => {
        if (roundTripMs !== before.roundTripMs) series.push(performance.now() / 1000, roundTripMs ?? NaN);
      }),
    [series],
  );
  return series;
}

const VOLTAGE_WINDOW_S = 600;

/** The battery's voltage of the last minutes. It is also collected while other tabs are shown, since the top bar subscribes to the battery anyway. */
export const VOLTAGES = new TimeSeries(VOLTAGE_WINDOW_S, 1200);

let followed = "";
let endFollowing = () => {};

export function useVoltages(topic: string): TimeSeries {
  useEffect(() => {
    if (followed === topic) return;
    endFollowing();
    VOLTAGES.clear();
    followed = topic;
    const row = { name: topic, type: TOPICS.BATTERY.type };
    endFollowing = topics.listen(row, {}, () => {
      const sample = topics.last(row);
      if (sample !== undefined) VOLTAGES.push(sample.receivedMs / 1000, sample.message.voltage);
    });
  }, [topic]);
  return VOLTAGES;
}
