/** The robot as this page reaches it: one link, its topics and services, the stop gate and the drive path. */
import { create } from "zustand";
import { type ConsoleState, hasControl, useConsole } from "@/api/console_store";
import { dropChannel, followServer } from "@/api/events";
import { pair, takeScannedCode } from "@/api/pairing";
import { postJson } from "@/api/http";
import { IS_MOCK, ROS_QUERY, rosbridgeUrl, socketUrl } from "@/environment";
import { SERVICES, TOPICS } from "@/generated/graph";
import type { MessageTypes, ServiceTypes } from "@/generated/messages";
import { CommandRefused, refuseCommand } from "@/safety/guard";
import { isRewound } from "@/state/rewind";
import { lostSince } from "@/ros/link_loss";
import { LinkLost, type LinkState, Rosbridge, type Socket } from "@/ros/rosbridge";
import { TopicStore } from "@/ros/topics";
import { followTabs, isWatching, useTabRole } from "@/safety/commanding_tab";
import { type Blocker, Driver, type Velocity, ZERO, isZero } from "@/safety/drive";
import { elsewhere, goElsewhere } from "@/safety/elsewhere";
import { StopOfConsole } from "@/safety/stop_of_console";
import { followFocus } from "@/safety/focus";
import { releaseStop } from "@/safety/release";
import { type Holder, StopGate, type StopReason } from "@/safety/stop_gate";
import { every } from "@/safety/timers";
import { ScreenOn } from "@/safety/wake_lock";
import { notePublication, noteStop, noteVelocity } from "@/state/publish_log";
import { showInfo, showProblem } from "@/state/problems";
import { useRoute } from "@/state/route";
import { setting } from "@/state/settings";
import { endHolds } from "@/ui/holds";

const PING_MS = 2000;
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

interface GateStore {
  engaged: boolean;
  reason: StopReason | null;
  sinceMs: number;
  /** Whether this page holds a stop at the server. */
  isStated: boolean;
  /** How often a person pressed the stop of this page. */
  presses: number;
  /** Whether the stop was handed to an open link, or the server has answered it another way. */
  wasSent: boolean;
  /** When this page began to hold it (performance.now()); null while it holds none. */
  statedMs: number | null;
}

export const useGate = create<GateStore>(() => ({ engaged: true, reason: "startup", sinceMs: performance.now(), isStated: false, presses: 0, wasSent: false, statedMs: null }));

interface DriveStore {
  commanded: Velocity;
  blocker: Blocker | null;
}

export const useDrive = create<DriveStore>(() => ({ commanded: ZERO, blocker: null }));

let openOtherSocket: (() => Socket) | null = null;

const bridgeUrl = rosbridgeUrl(ROS_QUERY ?? setting("rosUrl"));
goElsewhere(IS_MOCK || bridgeUrl === rosbridgeUrl(null) ? null : bridgeUrl);

export const link = new Rosbridge(() => openOtherSocket?.() ?? (new WebSocket(bridgeUrl) as unknown as Socket));
export const topics = new TopicStore(link);

/** A row of the graph's tables. */
interface Row<Type> {
  readonly name: string;
  readonly type: Type;
  readonly console?: string;
  readonly moves: boolean;
}

/** Throws CommandRefused where this page may not send a command now: what can lead to motion waits until its gate was opened. */
export function checkCommand(row: Pick<Row<string>, "console" | "moves">): void {
  refuseCommand(row);
  if (row.moves && gate.engaged) throw new CommandRefused(gate.isStated ? "command_while_stopped" : "command_while_closed");
}

/** Publish on a topic of the graph; returns false where the link is down. Throws CommandRefused. */
export function publish<Type extends keyof MessageTypes>(row: Row<Type>, message: Partial<MessageTypes[Type]>): boolean {
  checkCommand(row);
  const sent = link.publish(row.name, row.type, message);
  notePublication(row.name, message, sent);
  return sent;
}

/** Call a service of the graph. Rejects with LinkLost, CallFailed or CommandRefused. */
export async function call<Type extends keyof ServiceTypes>(
  row: Row<Type>,
  request: Partial<ServiceTypes[Type]["request"]>,
  timeoutMs?: number,
): Promise<ServiceTypes[Type]["response"]> {
  checkCommand(row);
  // What every client may call only reads, and is called all the time.
  if (row.console !== "viewer") notePublication(row.name, request, link.isOpen);
  return (await link.call(row.name, row.type, request, timeoutMs)) as ServiceTypes[Type]["response"];
}

function twist({ x, y, yaw }: Velocity) {
  const sign = setting("polarityInvertHmi") ? -1 : 1;
  return { linear: { x: sign * x, y: sign * y, z: 0 }, angular: { x: 0, y: 0, z: yaw } };
}

function sendVelocity(velocity: Velocity): void {
  const name = setting("cmdVelTopic");
  const isStamped = setting("cmdVelType") === "geometry_msgs/msg/TwistStamped";
  const sent = isStamped
    ? link.publish(name, "geometry_msgs/msg/TwistStamped", { header: { frame_id: setting("baseFrame") }, twist: twist(velocity) })
    : link.publish(name, "geometry_msgs/msg/Twist", twist(velocity));
  noteVelocity(name, twist(velocity), !isZero(velocity), sent);
}

/** What an operator of such a page stops is the robot that is near too. */
const nearStop = new StopOfConsole((body) => postJson("/_api/stop", body), showProblem);

export const gate = new StopGate({
  stateStop: (engaged, press) => {
    const wasSent = link.publish(TOPICS.HMI_ESTOP.name, TOPICS.HMI_ESTOP.type, { data: engaged }, press);
    noteStop(TOPICS.HMI_ESTOP.name, engaged, wasSent);
    if (engaged && wasSent) useGate.setState({ wasSent });
    if (elsewhere() !== null) nearStop.state(engaged, press);
  },
  zero: () => sendVelocity(ZERO),
  cancelGoals,
  changed: (state) => {
    useGate.setState((before) => ({
      ...state,
      wasSent: state.isStated && (before.wasSent || link.isOpen),
      statedMs: state.isStated ? (before.statedMs ?? performance.now()) : null,
    }));
    if (state.engaged) driver.letGo();
  },
});

function holderOf(state: ConsoleState): Holder {
  if (state.control.holder === null) return "nobody";
  // Another tab of this browser has the same name at the server.
  return hasControl(state) && useTabRole.getState().role === "commanding" ? "own" : "other";
}

const screenOn = new ScreenOn();

function applyControl(): void {
  const holder = holderOf(useConsole.getState());
  gate.setControl(holder);
  screenOn.want(holder === "own");
}

/** Cancel every goal of the navigation servers. Nothing waits for the answers. */
export function cancelGoals(): void {
  const everyGoal = { goal_info: { goal_id: { uuid: new Array<number>(16).fill(0) }, stamp: { sec: 0, nanosec: 0 } } };
  for (const row of [SERVICES.CANCEL_NAVIGATE_TO_POSE, SERVICES.CANCEL_NAVIGATE_THROUGH_POSES, SERVICES.CANCEL_FOLLOW_WAYPOINTS]) {
    link.call(row.name, row.type, everyGoal).catch(() => {});
  }
}

/** Why this page cannot command a velocity now; null where it can. */
export function driveBlocker(): Blocker | null {
  const state = useConsole.getState();
  if (!link.isOpen) return "no-link";
  if (isRewound()) return "rewound";
  if (isWatching()) return "other-tab";
  if (state.session?.role === "viewer") return "viewer";
  if (gate.engaged) return "stopped";
  if (state.control.holder !== null && !hasControl(state)) return "no-control";
  return null;
}

export const driver = new Driver(sendVelocity, driveBlocker, (commanded, blocker) => useDrive.setState({ commanded, blocker }), () => setting("speedScale"));

/** Stop the robot, for a person at this page. */
export function stop(reason: StopReason = "user"): void {
  endHolds();
  gate.engage(reason);
  useGate.setState(({ presses }) => ({ presses: presses + 1 }));
  stopWithoutLink();
}

/** A second way for the same word: it needs no open socket. */
function stopWithoutLink(): void {
  if (link.isOpen) return;
  postJson("/_api/stop", { engaged: true, press: gate.press })
    .then(() => useGate.setState(({ isStated }) => ({ wasSent: isStated })))
    .catch(() => {});
}

/** A stop of another browser that came while the release was held was not seen when that began. */
const SEEN_MS = 1000;

/** Take control, release this browser's stops and those of others that the operator has seen, and open the gate. Throws ApiError and TextError. */
export async function release(): Promise<void> {
  const { stop: stops, stopShownMs, session } = useConsole.getState();
  const shownBeforeMs = performance.now() - SEEN_MS;
  const seen = stops.filter(({ press, name }) => press !== null && (name === session?.name || (stopShownMs[press] ?? Infinity) <= shownBeforeMs));
  await releaseStop({ gate, postJson, restate: stopWithoutLink, seen });
  // After a stop, the drive bus passes a stick on once it has heard of it at rest, or nothing for 2 s. Where nothing was stopped,
  // a zero would hold what drives.
  if (stops.length > 0) sendVelocity(ZERO);
}

/** Let go of this page's stop. The robot stays stopped while anything else holds it. */
export function withdrawStop(): void {
  gate.withdraw();
}

/** The robot's time in s at a time of performance.now(), to some milliseconds; null where its clock is not known. */
export function robotTime(atMs: number): number | null {
  const { clockOffsetS } = useLink.getState();
  return clockOffsetS === null ? null : atMs / 1000 + clockOffsetS;
}

let silentPings = 0;

async function ping(): Promise<void> {
  if (!link.isOpen) return;
  const start = performance.now();
  const received = link.received;
  try {
    const { time } = await call(SERVICES.GET_TIME, {}, PING_MS);
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

/** A server within the page, in place of the console's. */
export interface PageServer {
  openSocket: () => Socket;
  startServer: () => void;
}

/** Connect, to the console's server or to one within the page, and keep connected. Called once. */
export function startRobot(server: PageServer | null = null): void {
  link.onState = (state) => {
    useLink.setState((before) => ({
      state,
      changedMs: before.state === state ? before.changedMs : performance.now(),
      wasOpen: before.wasOpen || state === "open",
      lostMs: lostSince(before, state, performance.now()),
      roundTripMs: state === "open" ? before.roundTripMs : null,
    }));
    gate.setConnected(state === "open", useConsole.getState().online);
    if (state === "open") void ping();
    else driver.letGo();
  };
  link.onStatus = (level, text, id) => {
    if (id === gate.press) {
      if (gate.isStated) showInfo("stop_released_by", { name: text });
      gate.forget();
      return;
    }
    useLink.setState({ refusal: { text, receivedMs: performance.now() } });
    // A publication has no answer: its refusal is only said here.
    if (level === "error") showProblem(new Error(text));
  };
  useConsole.subscribe((state, before) => {
    // Every answer of the server is an object of its own, also if it says the same again.
    if (state.control !== before.control || state.session !== before.session) applyControl();
  });
  useTabRole.subscribe(({ role }, before) => {
    // Nothing of this tab may be what the wheels did last: another one commands now.
    if (role === "watching" && before.role === "commanding" && !gate.engaged) sendVelocity(ZERO);
    applyControl();
  });
  if (elsewhere() === null) followTabs();
  // What the view of another tab holds, nobody sees any more.
  useRoute.subscribe(({ tab }, before) => {
    if (tab !== before.tab) driver.letGo();
  });
  gate.start();
  every(PING_MS, () => void ping());
  window.addEventListener("beforeunload", () => gate.engage("before-unload"));
  window.addEventListener("online", () => link.reconnectNow());
  followFocus(() => driver.letGo(), () => engageOnFocusLoss("window-blur"));
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) engageOnFocusLoss("visibility-hidden");
    else {
      link.reconnectNow();
      screenOn.shownAgain();
    }
  });
  if (server !== null) {
    openOtherSocket = server.openSocket;
    server.startServer();
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
  if (useConsole.getState().session !== null) {
    link.connect();
    return;
  }
  const end = useConsole.subscribe((state) => {
    if (state.session !== null) {
      end();
      link.connect();
    }
  });
}
