/** Keeps the live map up to date while a view of it is shown. */
import { useEffect } from "react";
import { TOPICS } from "@/generated/graph";
import { useSamples } from "@/hooks/use_topic";
import { useSetting } from "@/state/settings";
import { readBoxes } from "./boxes";
import { liveMap } from "./live_map";
import { readTwin } from "./twin";

/** All nodes together publish transforms too often to receive each one. */
const TF_THROTTLE_MS = 100;

export function useLiveMap(): void {
  const map = useSetting("mapFrame");
  const base = useSetting("baseFrame");
  const [mapTopic, planTopic, scanTopic] = [useSetting("mapTopic"), useSetting("planTopic"), useSetting("scanTopic")];
  const odomTopic = useSetting("odomTopic");

  useEffect(() => {
    liveMap.follow(map, base);
    return () => liveMap.forgetTransforms();
  }, [map, base]);

  useSamples({ name: mapTopic, type: TOPICS.MAP.type }, ({ message, receivedMs }) => liveMap.takeGrid(message, receivedMs));
  useSamples(TOPICS.TF_STATIC, ({ message, receivedMs }) => liveMap.takeStaticTransforms(message, receivedMs));
  useSamples(TOPICS.TF, ({ message, receivedMs }) => liveMap.takeTransforms(message, receivedMs), { throttleMs: TF_THROTTLE_MS });
  useSamples({ name: odomTopic, type: TOPICS.ODOM.type }, ({ message, receivedMs }) => liveMap.takeOdometry(message, receivedMs), {
    throttleMs: TF_THROTTLE_MS,
  });
  useSamples({ name: scanTopic, type: TOPICS.SCAN.type }, ({ message, receivedMs }) => liveMap.takeScan(message, receivedMs));
  useSamples({ name: planTopic, type: TOPICS.PLAN.type }, ({ message, receivedMs }) => liveMap.takePlan(message, receivedMs));
  useSamples(TOPICS.TWIN_STATE, ({ message, receivedMs }) => liveMap.takeTags(readTwin(message), receivedMs));
  useSamples(TOPICS.OBSERVATIONS, ({ message, receivedMs }) => liveMap.takeObservation(message, receivedMs));
  useSamples(TOPICS.BOX_GEOMETRY, ({ message }) => liveMap.takeBoxes(readBoxes(message.data)));
}
