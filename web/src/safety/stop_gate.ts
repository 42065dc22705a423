/**
 * Layer 1 of the e-stop: whether this page lets any command pass that moves the robot.
 *
 * The page starts stopped and is released by hand only. Its stop is a value of its own at the server, which combines those of
 * all consoles; the robot's own stop (the button, other consoles) is seen in `/e_stop_state` and never changed from here.
 *
 * A page that merely watches must not stop a mission by being opened, hidden or closed. So a stop that no person asked for
 * (start, focus, disconnect, unload) reaches the robot only from the page that has control; at any other page it closes the
 * page's own gate.
 */

export type StopReason =
  | "user"
  | "voice-agent"
  | "visibility-hidden"
  | "window-blur"
  | "before-unload"
  | "rosbridge-disconnect"
  | "startup";

/** An outage must last this long, from its first drop, before it stops the page for good. */
export const DISCONNECT_GRACE_MS = 5000;
export const HEARTBEAT_MS = 50;
export const STATE_MS = 500;

export interface Outputs {
  /** State this page's stop to the server. */
  stateStop: (engaged: boolean) => void;
  /** Command zero velocity. */
  zero: () => void;
  /** Cancel every goal of both navigation servers. */
  cancelGoals: () => void;
  /** Called after every change. */
  changed: (gate: { engaged: boolean; reason: StopReason | null; sinceMs: number }) => void;
}

/** Pure but for its timers, which `start` and `close` begin and end. */
export class StopGate {
  engaged = true;
  reason: StopReason | null = "startup";
  sinceMs: number;

  /** Whether this page's stop is stated to the robot, and not only kept here. */
  private stated = false;
  private inControl = false;
  private wasConnected = false;
  private connected = false;
  private outageTimer: ReturnType<typeof setTimeout> | undefined;
  private timers: ReturnType<typeof setInterval>[] = [];

  constructor(
    private readonly outputs: Outputs,
    private readonly now: () => number = () => performance.now(),
  ) {
    this.sinceMs = this.now();
  }

  start(): void {
    this.timers = [
      setInterval(() => {
        if (this.engaged && this.connected && this.inControl) this.outputs.zero();
      }, HEARTBEAT_MS),
      setInterval(() => {
        if (this.connected && (this.stated || this.inControl)) this.outputs.stateStop(this.stated);
      }, STATE_MS),
    ];
  }

  close(): void {
    for (const timer of this.timers) clearInterval(timer);
    clearTimeout(this.outageTimer);
  }

  /** Stop. A stop by a person always reaches the robot, whoever has control. */
  engage(reason: StopReason): void {
    const byPerson = reason === "user" || reason === "voice-agent";
    const state = byPerson || this.inControl;
    if (!this.engaged || (byPerson && !this.stated)) {
      this.engaged = true;
      this.reason = reason;
      this.sinceMs = this.now();
    }
    if (state) {
      this.stated = true;
      this.outputs.stateStop(true);
      if (this.inControl) this.outputs.zero();
      this.outputs.cancelGoals();
    }
    this.report();
  }

  /** Open the gate, after the server has released this page's stop. */
  release(): void {
    this.stated = false;
    this.engaged = false;
    this.reason = null;
    this.sinceMs = this.now();
    this.report();
  }

  /** Whether the stop of this page is held at the server. */
  get isStated(): boolean {
    return this.stated;
  }

  setControl(inControl: boolean): void {
    if (this.inControl && !inControl && !this.engaged) {
      // Whoever lost control has to open the gate again before the next command.
      this.inControl = false;
      this.engaged = true;
      this.reason = "startup";
      this.sinceMs = this.now();
      this.report();
      return;
    }
    this.inControl = inControl;
  }

  setConnected(connected: boolean): void {
    if (connected === this.connected) return;
    this.connected = connected;
    if (connected) {
      this.wasConnected = true;
      clearTimeout(this.outageTimer);
      this.outageTimer = undefined;
      if (this.stated) this.outputs.stateStop(true);
    } else if (this.wasConnected && this.outageTimer === undefined) {
      // Reconnect attempts do not restart the timer. The server itself stops a page that was driving at once.
      this.outageTimer = setTimeout(() => this.engage("rosbridge-disconnect"), DISCONNECT_GRACE_MS);
    }
  }

  private report(): void {
    this.outputs.changed({ engaged: this.engaged, reason: this.reason, sinceMs: this.sinceMs });
  }
}
