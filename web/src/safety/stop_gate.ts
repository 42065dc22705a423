/**
 * Layer 1 of the e-stop: whether this page lets any command pass that moves the robot.
 *
 * The page starts stopped and is released by hand only. Its stop is a value of its own at the server, which combines those of
 * all consoles; the robot's own stop (the button, other consoles) is seen in `/e_stop_state` and never changed from here.
 *
 * A page that merely watches must not stop a mission by being opened, hidden or closed. So a stop that no person asked for
 * (start, focus, disconnect, unload) reaches the robot only from the page that has control; at any other page it closes the
 * page's own gate. After an outage it waits until the server has said who has control now.
 *
 * While a stop of this page is stated and it has control, the page also sends zero velocity. A gate that is merely closed sends
 * none: it has let nothing pass, so its zeros would hold the wheels against a mission or a goal, which nobody asked for.
 *
 * Each press has a name of its own: the server tells a repetition from a new press by it, and whoever has control releases the
 * presses that it has seen.
 */

import { type EndTimer, after, every } from "./timers";

export type StopReason =
  | "user"
  | "voice-agent"
  | "visibility-hidden"
  | "window-blur"
  | "before-unload"
  | "rosbridge-disconnect"
  | "control-lost"
  | "startup";

/** Who has control: this page, another one, or nobody. */
export type Holder = "own" | "other" | "nobody";

/** An outage must last this long, from its first drop, before it stops the page for good. */
export const DISCONNECT_GRACE_MS = 5000;
export const HEARTBEAT_MS = 50;
export const STATE_MS = 500;

export interface GateState {
  engaged: boolean;
  reason: StopReason | null;
  sinceMs: number;
  isStated: boolean;
}

export interface Outputs {
  /** State this page's stop to the server: the press that is held, or let go of. */
  stateStop: (engaged: boolean, press: string) => void;
  /** Command zero velocity. */
  zero: () => void;
  /** Cancel every goal of both navigation servers. */
  cancelGoals: () => void;
  /** Called after every change. */
  changed: (gate: GateState) => void;
}

/** Whether a person asked for the stop. */
function isPersonal(reason: StopReason | null): boolean {
  return reason === "user" || reason === "voice-agent";
}

/** No other page has this name, and it is no secret; `crypto.randomUUID` is missing where the page came over plain HTTP. */
const PAGE = `press:${Date.now().toString(36)}${Math.random().toString(36).slice(2)}`;

/** Whether a stop at the server is one of this page. */
export function isOwnPress(press: unknown): boolean {
  return typeof press === "string" && (press === PAGE || press.startsWith(`${PAGE}-`));
}

/** Pure but for its timers, which `start` and `close` begin and end. */
export class StopGate {
  engaged = true;
  reason: StopReason | null = "startup";
  sinceMs: number;
  /** How often the gate was closed, or told to close again; a release that sees it grow was overruled. */
  closings = 0;

  /** The name of the last stop of this page. */
  press = PAGE;

  private presses = 0;
  /** Whether this page's stop is stated to the robot, and not only kept here. */
  private stated = false;
  /** Whether an automatic stop waits for the next news of who has control. */
  private pending = false;
  private holder: Holder = "nobody";
  /** Whether `holder` is from after the last reconnection. */
  private isHolderCurrent = true;
  private wasConnected = false;
  private connected = false;
  private endOutage: EndTimer | undefined;
  private ends: EndTimer[] = [];

  constructor(
    private readonly outputs: Outputs,
    private readonly now: () => number = () => performance.now(),
  ) {
    this.sinceMs = this.now();
  }

  start(): void {
    this.ends = [
      every(HEARTBEAT_MS, () => {
        if (this.holdsWheels) this.outputs.zero();
      }),
      every(STATE_MS, () => {
        if (this.connected && (this.stated || this.commands)) this.outputs.stateStop(this.stated, this.press);
      }),
    ];
  }

  close(): void {
    for (const end of this.ends) end();
    this.endOutage?.();
  }

  /** Whether this page keeps the wheels at zero velocity, so that nothing of a lower priority moves them. */
  get holdsWheels(): boolean {
    return this.engaged && this.stated && this.connected && this.commands;
  }

  /** Stop. A stop by a person always reaches the robot, whoever has control. */
  engage(reason: StopReason): void {
    this.closings += 1;
    const byPerson = isPersonal(reason);
    const isNew = byPerson ? !isPersonal(this.reason) || !this.stated : this.holder === "own" && !this.stated && !this.pending;
    if (!this.engaged || isNew) this.shut(reason);
    if (byPerson || (!this.stated && !this.pending)) {
      this.presses += 1;
      this.press = `${PAGE}-${this.presses}`;
    }
    if (byPerson || (this.connected && this.commands)) this.state();
    else if (this.holder === "own") this.pending = true;
    this.report();
  }

  /** Open the gate, after the server has released this page's stop. */
  release(): void {
    this.stated = false;
    this.pending = false;
    this.engaged = false;
    this.reason = null;
    this.sinceMs = this.now();
    this.report();
  }

  /** Let go of this page's stop, with the gate still closed. */
  withdraw(): void {
    this.stated = false;
    this.pending = false;
    this.outputs.stateStop(false, this.press);
    this.report();
  }

  /** Repeat this page's stop no more, as somebody else has released it. The gate stays closed. */
  forget(): void {
    this.stated = false;
    this.pending = false;
    this.report();
  }

  /** Whether the stop of this page is held at the server. */
  get isStated(): boolean {
    return this.stated;
  }

  /** News of who has control. */
  setControl(holder: Holder): void {
    const hadControl = this.holder === "own";
    this.holder = holder;
    this.isHolderCurrent = true;
    if (hadControl && holder !== "own") {
      this.closings += 1;
      // Whoever lost control has to open the gate again before the next command.
      if (!this.engaged) {
        this.shut("control-lost");
        this.report();
      }
    }
    this.settle();
  }

  /** `isHolderCurrent`: the last news of who has control still holds, as they come by a channel that was not interrupted. */
  setConnected(connected: boolean, isHolderCurrent = true): void {
    if (connected === this.connected) return;
    this.connected = connected;
    if (connected) {
      if (this.wasConnected) this.isHolderCurrent = isHolderCurrent;
      this.wasConnected = true;
      this.endOutage?.();
      this.endOutage = undefined;
      if (!this.stated) {
        this.settle();
        return;
      }
      if (isPersonal(this.reason)) this.outputs.stateStop(true, this.press);
      else {
        // Meanwhile somebody may have released it at the server, and may be driving.
        this.stated = false;
        this.pending = true;
        this.settle();
        this.report();
      }
    } else if (this.wasConnected && this.endOutage === undefined) {
      // Reconnect attempts do not restart the timer. The server itself stops a page that was driving at once.
      this.endOutage = after(DISCONNECT_GRACE_MS, () => this.engage("rosbridge-disconnect"));
    }
  }

  /** Whether this page has control, and knows it from after the last reconnection. */
  private get commands(): boolean {
    return this.holder === "own" && this.isHolderCurrent;
  }

  private shut(reason: StopReason): void {
    this.engaged = true;
    this.reason = reason;
    this.sinceMs = this.now();
  }

  private state(): void {
    this.pending = false;
    this.stated = true;
    this.outputs.stateStop(true, this.press);
    if (this.commands) this.outputs.zero();
    this.outputs.cancelGoals();
  }

  /** Decide on an automatic stop that waited: where somebody else has control by now, it only closes this gate. */
  private settle(): void {
    if (!this.pending || !this.connected || !this.isHolderCurrent) return;
    this.pending = false;
    if (this.holder !== "other") this.state();
    this.report();
  }

  private report(): void {
    this.outputs.changed({ engaged: this.engaged, reason: this.reason, sinceMs: this.sinceMs, isStated: this.stated });
  }
}
