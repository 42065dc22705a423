/** The robot as this page reaches it: one link, its topics and services, the stop gate and the drive path. */
import { create } from "zustand";
import { hasControl, useConsole } from "@/api/console_store";
import { followServer } from "@/api/events";
import { pair, takeScannedCode } from "@/api/pairing";
import { ask } from "@/api/http";
import { IS_MOCK, rosbridgeUrl, socketUrl } from "@/environment";
import { SERVICES, TOPICS } from "@/generated/graph";
import type { MessageTypes, ServiceTypes } from "@/generated/messages";
import { type LinkState, Rosbridge, type Socket } from "@/ros/rosbridge";
import { TopicStore } from "@/ros/topics";
import { type Blocker, Driver, type Velocity, ZERO } from "@/safety/drive";
import { StopGate, type StopReason } from "@/safety/stop_gate";
import { notePublication } from "@/state/publish_log";
import { showProblem } from "@/state/problems";
import { setting } from "@/state/settings";

const PING_MS = 2000;

interface LinkStore {
  state: LinkState;
  /** performance.now() of the last change. */
  changedMs: number;
  /** Whether the link was ever open. */
  wasOpen: boolean;
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
  roundTripMs: null,
  clockOffsetS: null,
  refusal: null,
}));

interface GateStore {
  engaged: boolean;
  reason: StopReason | null;
  sinceMs: number;
}

export const useGate = create<GateStore>(() => ({ engaged: true, reason: "startup", sinceMs: performance.now() }));

interface DriveStore {
  commanded: Velocity;
  blocker: Blocker | null;
}

export const useDrive = create<DriveStore>(() => ({ commanded: ZERO, blocker: null }));

let openMockSocket: (() => Socket) | null = null;

export const link = new Rosbridge(() => openMockSocket?.() ?? (new WebSocket(rosbridgeUrl()) as unknown as Socket));
export const topics = new TopicStore(link);

/** Publish on a topic of the graph; returns false where the link is down. */
export function publish<Type extends keyof MessageTypes>(
  row: { readonly name: string; readonly type: Type },
  message: Partial<MessageTypes[Type]>,
): boolean {
  const sent = link.publish(row.name, row.type, message);
  notePublication(row.name, message, sent);
  return sent;
}

/** Call a service of the graph. Rejects with LinkLost or CallFailed. */
export async function call<Type extends keyof ServiceTypes>(
  row: { readonly name: string; readonly type: Type },
  request: Partial<ServiceTypes[Type]["request"]>,
  timeoutMs?: number,
): Promise<ServiceTypes[Type]["response"]> {
  return (await link.call(row.name, row.type, request, timeoutMs)) as ServiceTypes[Type]["response"];
}

function twist({ x, y, yaw }: Velocity) {
  const sign = setting("polarityInvertHmi") ? -1 : 1;
  return { linear: { x: sign * x, y: sign * y, z: 0 }, angular: { x: 0, y: 0, z: yaw } };
}

function sendVelocity(velocity: Velocity): void {
  const name = setting("cmdVelTopic");
  if (setting("cmdVelType") === "geometry_msgs/msg/TwistStamped") {
    link.publish(name, "geometry_msgs/msg/TwistStamped", { header: { frame_id: setting("baseFrame") }, twist: twist(velocity) });
  } else {
    link.publish(name, "geometry_msgs/msg/Twist", twist(velocity));
  }
}

export const gate = new StopGate({
  stateStop: (engaged) => void link.publish(TOPICS.HMI_ESTOP.name, TOPICS.HMI_ESTOP.type, { data: engaged }),
  zero: () => sendVelocity(ZERO),
  cancelGoals,
  changed: (state) => {
    useGate.setState(state);
    if (state.engaged) driver.letGo();
  },
});

/** Cancel every goal of both navigation servers. Nothing waits for the answers. */
export function cancelGoals(): void {
  const everyGoal = { goal_info: { goal_id: { uuid: new Array<number>(16).fill(0) }, stamp: { sec: 0, nanosec: 0 } } };
  for (const row of [SERVICES.CANCEL_NAVIGATE_TO_POSE, SERVICES.CANCEL_NAVIGATE_THROUGH_POSES]) {
    link.call(row.name, row.type, everyGoal).catch(() => {});
  }
}

/** Why this page cannot command a velocity now; null where it can. */
export function driveBlocker(): Blocker | null {
  const state = useConsole.getState();
  if (!link.isOpen) return "no-link";
  if (state.own?.role === "viewer") return "viewer";
  if (gate.engaged) return "stopped";
  if (state.control.holder !== null && !hasControl(state)) return "no-control";
  return null;
}

export const driver = new Driver(sendVelocity, driveBlocker, (commanded, blocker) => useDrive.setState({ commanded, blocker }));

/** Stop the robot, for a person at this page. */
export function stop(reason: StopReason = "user"): void {
  gate.engage(reason);
  // A second way for the same word: it needs no open socket.
  if (!link.isOpen) ask("/_api/stop", { engaged: true }).catch(() => {});
}

/** Take control and release what this page and lost pages hold. Throws ApiError with the reason. */
export async function release(): Promise<void> {
  await ask("/_api/lease", { action: "take" });
  if (gate.isStated) link.publish(TOPICS.HMI_ESTOP.name, TOPICS.HMI_ESTOP.type, { data: false });
  await ask("/_api/stop", { engaged: false });
  gate.release();
}

/** The robot's time in s at a time of performance.now(), to some milliseconds; null where its clock is not known. */
export function robotTime(atMs: number): number | null {
  const { clockOffsetS } = useLink.getState();
  return clockOffsetS === null ? null : atMs / 1000 + clockOffsetS;
}

async function ping(): Promise<void> {
  if (!link.isOpen) return;
  const start = performance.now();
  try {
    const { time } = await call(SERVICES.GET_TIME, {}, PING_MS);
    const roundTripMs = performance.now() - start;
    const clockOffsetS = time.sec + time.nanosec / 1e9 - (start + roundTripMs / 2) / 1000;
    useLink.setState({ roundTripMs, clockOffsetS });
  } catch {
    useLink.setState({ roundTripMs: null });
  }
}

/** Connect, and keep connected. Called once. */
export async function startRobot(): Promise<void> {
  link.onState = (state) => {
    useLink.setState((before) => ({
      state,
      changedMs: before.state === state ? before.changedMs : performance.now(),
      wasOpen: before.wasOpen || state === "open",
      roundTripMs: state === "open" ? before.roundTripMs : null,
    }));
    gate.setConnected(state === "open");
    if (state === "open") void ping();
    else driver.letGo();
  };
  link.onStatus = (level, text) => {
    useLink.setState({ refusal: { text, receivedMs: performance.now() } });
    // A publication has no answer: its refusal is only said here.
    if (level === "error") showProblem(new Error(text));
  };
  useConsole.subscribe((state) => gate.setControl(hasControl(state)));
  gate.start();
  setInterval(() => void ping(), PING_MS);
  window.addEventListener("beforeunload", () => gate.engage("before-unload"));
  window.addEventListener("online", () => link.reconnectNow());
  window.addEventListener("blur", () => engageOnFocusLoss("window-blur"));
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) engageOnFocusLoss("visibility-hidden");
    else link.reconnectNow();
  });
  if (IS_MOCK) {
    const mock = await import("@/mock/mock");
    openMockSocket = mock.openSocket;
    mock.startServer();
    link.connect();
    return;
  }
  const scanned = takeScannedCode();
  if (scanned === null) void followServer(socketUrl("/_api/events"));
  else pair(scanned).catch(() => followServer(socketUrl("/_api/events")));
  connectOncePaired();
}

function engageOnFocusLoss(reason: StopReason): void {
  driver.letGo();
  if (setting("estopAutoOnFocusLoss")) gate.engage(reason);
}

/** rosbridge refuses a browser that is not paired, so the link waits for that. */
function connectOncePaired(): void {
  if (useConsole.getState().own !== null) {
    link.connect();
    return;
  }
  const end = useConsole.subscribe((state) => {
    if (state.own !== null) {
      end();
      link.connect();
    }
  });
}
