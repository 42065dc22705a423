/** The page's one link to rosbridge: its state, its topics, and the pings that find it dead. */
import { create } from "zustand";
import { dropChannel } from "@/api/events";
import { IS_MOCK, ROS_QUERY, rosbridgeUrl } from "@/environment";
import { SERVICES } from "@/generated/graph";
import type { ServiceTypes } from "@/generated/messages";
import { LinkLost, type LinkState, Rosbridge, type Socket } from "@/ros/rosbridge";
import { TopicStore } from "@/ros/topics";
import { goElsewhere } from "@/safety/elsewhere";
import { setting } from "@/state/settings";

export const PING_MS = 2000;
/** After this many pings without an answer, or anything else, the link is dead, whatever the browser believes. */
const SILENT_PINGS = 2;

interface LinkStore {
  state: LinkState;
  /** performance.now() of the last change. */
  changedMs: number;
  /** Whether the link was ever open. */
  wasOpen: boolean;
  /** When the open link was lost (performance.now()); null again once it is open and something was received. */
  lostMs: number | null;
  /** The last round trip to the server; null before the first. */
  roundTripMs: number | null;
  /** The robot's clock minus performance.now(), s; null before it was asked. */
  clockOffsetS: number | null;
  /** What the server refused last, with the time of its arrival. */
  refusal: { text: string; receivedMs: number } | null;
}

export const useLink = create<LinkStore>(() => ({
  state: "connecting",
  changedMs: performance.now(),
  wasOpen: false,
  lostMs: null,
  roundTripMs: null,
  clockOffsetS: null,
  refusal: null,
}));

let openOtherSocket: (() => Socket) | null = null;

const bridgeUrl = rosbridgeUrl(ROS_QUERY ?? setting("rosUrl"));
goElsewhere(IS_MOCK || bridgeUrl === rosbridgeUrl(null) ? null : bridgeUrl);

export const link = new Rosbridge(() => openOtherSocket?.() ?? (new WebSocket(bridgeUrl) as unknown as Socket));
export const topics = new TopicStore(link);

/** Connect to a server within the page from now on, in place of the console's. */
export function openBy(open: () => Socket): void {
  openOtherSocket = open;
}

/** The robot's time in s at a time of performance.now(), to some milliseconds; null where its clock is not known. */
export function robotTime(atMs: number): number | null {
  const { clockOffsetS } = useLink.getState();
  return clockOffsetS === null ? null : atMs / 1000 + clockOffsetS;
}

let silentPings = 0;

/** Measure the round trip and the robot's clock; a link that stays silent is dropped. */
export async function ping(): Promise<void> {
  if (!link.isOpen) return;
  const start = performance.now();
  const received = link.received;
  try {
    const { name, type } = SERVICES.GET_TIME;
    const { time } = (await link.call(name, type, {}, PING_MS)) as ServiceTypes[typeof type]["response"];
    const roundTripMs = performance.now() - start;
    const clockOffsetS = time.sec + time.nanosec / 1e9 - (start + roundTripMs / 2) / 1000;
    useLink.setState({ roundTripMs, clockOffsetS, lostMs: null });
    silentPings = 0;
  } catch (error) {
    useLink.setState({ roundTripMs: null });
    if (error instanceof LinkLost) return;
    silentPings = link.received === received ? silentPings + 1 : 0;
    if (silentPings === 0) useLink.setState({ lostMs: null });
    if (silentPings < SILENT_PINGS) return;
    silentPings = 0;
    link.drop();
    dropChannel();
  }
}
