/** Connects the page: link, stop, driving, control, tabs and the window's events. */
import { type ConsoleState, hasControl, useConsole } from "@/api/console_store";
import { followServer } from "@/api/events";
import { pair, takeScannedCode } from "@/api/pairing";
import { socketUrl } from "@/environment";
import { lostSince } from "@/ros/link_loss";
import type { Socket } from "@/ros/rosbridge";
import { followTabs, useTabRole } from "@/safety/commanding_tab";
import { ZERO } from "@/safety/drive";
import { elsewhere } from "@/safety/elsewhere";
import { followFocus } from "@/safety/focus";
import type { Holder, StopReason } from "@/safety/stop_gate";
import { every } from "@/safety/timers";
import { ScreenOn } from "@/safety/wake_lock";
import { showInfo, showProblem } from "@/state/problems";
import { useRoute } from "@/state/route";
import { setting } from "@/state/settings";
import { driver } from "./driving";
import { PING_MS, link, openBy, ping, useLink } from "./link";
import { gate } from "./stop";
import { sendVelocity } from "./velocity";

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
    openBy(server.openSocket);
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
