/** Who has control in the mock mode, and who stops the robot: the rules of the console's server. */
import type { ConsoleEvent, Control, Session, StopHold } from "@/api/console_store";
import { AUTHORITY } from "@/generated/robot";
import type { MockOptions } from "./options";
import { say } from "./sentences";
import type { World } from "./world";

export const OTHER = "phone-2";
export const BUTTON = say("button_pressed");
const OWN_NAME = "laptop-1";
const WATCHING: Session = { name: "tablet-1", role: "viewer" };
/** How long the other browser takes to hand over. */
const ANSWER_MS = 4000;
/** When the other browser asks for control, after the page was opened. */
const ASKS_AFTER_MS = 1500;

interface Hold {
  kind: "pressed" | "left";
  name: string;
  press: string;
  text: string;
  /** performance.now(). */
  sinceMs: number;
}

/** A request that is refused; `status` is that of the answer. */
export class RequestRefused extends Error {
  constructor(
    message: string,
    readonly status = 403,
  ) {
    super(message);
  }
}

export class MockAuthority {
  readonly own: Session;
  control: Control = { holder: null, since_s: null, requester: null };
  private askedMs = 0;
  /** What has changed, as the server's history has it. */
  readonly events: ConsoleEvent[] = [];
  /** Called with every change. */
  onEvent: (event: ConsoleEvent) => void = () => {};
  /** What stops the robot, but for its button; this browser's own press is one of them. */
  private holds: Hold[] = [];
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly options: MockOptions,
    private readonly world: World,
    private readonly changed: () => void,
  ) {
    this.own = { name: OWN_NAME, role: options.role };
    if (options.control === "phone") this.give(OTHER);
    if (options.control === "you" || options.control === "asked") this.give(OWN_NAME);
    if (options.control === "asked") setTimeout(() => this.ask(OTHER), ASKS_AFTER_MS);
    if (options.state === "stopped") this.hold("left", OTHER, "press:other");
    if (options.faults.has("agent")) this.hold("left", say("voice_agent_of", { name: OTHER }), "press:agent");
    this.update();
  }

  get hasControl(): boolean {
    return this.control.holder === this.own.name;
  }

  /** Who has control, as the server pushes it. */
  get state(): Control {
    if (this.control.requester === null) return this.control;
    const leftS = AUTHORITY.requestS - (performance.now() - this.askedMs) / 1000;
    return { ...this.control, answer_within_s: Math.max(0, Math.ceil(leftS)) };
  }

  /** Who is connected: this browser, one that watches, and the other one where it has a part. */
  get browsers(): Session[] {
    const hasPart = this.control.holder === OTHER || this.control.requester === OTHER;
    return [this.own, ...(hasPart ? [{ name: OTHER, role: "operator" as const }] : []), WATCHING];
  }

  /** What stops the robot, as the server says it. */
  get stops(): StopHold[] {
    const nowMs = performance.now();
    const held = this.holds.map(({ sinceMs, ...hold }) => ({ ...hold, age_s: Math.floor((nowMs - sinceMs) / 1000) }));
    return this.isButtonPressed ? [...held, { kind: "robot", text: BUTTON, press: null, name: null, age_s: null }] : held;
  }

  /** Every reason for which the robot is stopped, as `/lupin/estop/status` has them. */
  get estopReasons(): string[] {
    const button = this.isButtonPressed ? [BUTTON] : [];
    return this.holds.length > 0 ? [...button, say("browser_holds_stop")] : button;
  }

  private get isButtonPressed(): boolean {
    return this.options.faults.has("button");
  }

  /** Take control where it is free; refuse where it is not. */
  take(): void {
    this.checkTake();
    if (this.hasControl) return;
    this.note("control_taken", this.own.name);
    this.give(this.own.name);
  }

  /** Refuse where control could not be taken, without taking it. */
  checkTake(): void {
    this.requireOperator();
    const { holder, since_s } = this.control;
    if (holder === null || holder === this.own.name) return;
    const seconds = Math.round(Date.now() / 1000 - (since_s ?? 0));
    throw new RequestRefused(say("control_held", { name: holder, seconds }));
  }

  private requireOperator(): void {
    if (this.own.role !== "operator") {
      throw new RequestRefused(say("is_viewer", { name: this.own.name }));
    }
  }

  lease(action: string, from: string): Control {
    switch (action) {
      case "take":
        this.take();
        break;
      case "request":
        this.requireOperator();
        if (this.control.holder === null) this.take();
        else this.ask(this.own.name);
        break;
      case "grant":
      case "refuse":
        this.answer(action === "grant");
        break;
      case "give_up":
        if (this.control.requester === this.own.name) this.control = { ...this.control, requester: null };
        else if (this.hasControl) this.note("control_given_up", this.own.name);
        if (this.hasControl) this.give(this.control.requester);
        break;
      case "take_over":
        this.requireOperator();
        if (from !== this.control.holder) throw new RequestRefused(`control is with ${this.control.holder ?? "nobody"} now`, 409);
        this.control = { holder: null, since_s: null, requester: null };
        this.take();
        break;
      default:
        throw new RequestRefused("action must be one of take, request, grant, refuse, give_up, take_over", 400);
    }
    this.changed();
    return this.control;
  }

  /** This browser's own stop: engage it, or let go of it. */
  setStop(engaged: boolean, press: string): void {
    const own = this.holds.find(({ kind, name }) => kind === "pressed" && name === this.own.name);
    if (engaged === (own !== undefined) && (!engaged || own?.press === press)) return;
    this.holds = this.holds.filter((hold) => hold !== own && hold.press !== press);
    if (engaged) this.hold("pressed", this.own.name, press);
    else this.note("stop_withdrawn", this.own.name);
    this.update();
  }

  /** Stop for a browser without a link. */
  stopWithoutLink(press: string): StopHold[] {
    this.holds = this.holds.filter((hold) => hold.press !== press);
    this.hold("left", this.own.name, press);
    this.update();
    return this.stops;
  }

  /** Release the stops of these presses. */
  release(presses: readonly string[]): StopHold[] {
    this.take();
    for (const { name } of this.holds.filter(({ press }) => presses.includes(press))) this.note("stop_released", this.own.name, name);
    this.holds = this.holds.filter(({ press }) => !presses.includes(press));
    this.update();
    return this.stops;
  }

  private hold(kind: "pressed" | "left", name: string, press: string): void {
    this.note(`stop_${kind}`, name);
    const text = kind === "pressed" ? `${name} holds the stop` : `${name} stopped the robot`;
    this.holds = [...this.holds, { kind, name, press, text, sinceMs: performance.now() }];
  }

  private update(): void {
    const before = this.world.isStopped;
    this.world.stopReasons = this.options.faults.has("deaf") ? [] : this.estopReasons;
    if (!before && this.world.isStopped) this.world.stopAll();
    this.changed();
  }

  private note(kind: string, name: string, other = ""): void {
    const event = { number: this.events.length + 1, robot_s: this.world.clockS, kind, name, other };
    this.events.push(event);
    this.onEvent(event);
  }

  private ask(requester: string): void {
    if (this.control.requester !== null && this.control.requester !== requester) {
      throw new RequestRefused(say("other_asks", { name: this.control.requester }));
    }
    this.control = { ...this.control, requester };
    this.askedMs = performance.now();
    this.note("control_requested", requester, this.control.holder ?? "");
    clearTimeout(this.timer);
    const isMine = requester === this.own.name;
    this.timer = setTimeout(() => this.end(isMine), isMine ? ANSWER_MS : AUTHORITY.requestS * 1000);
    this.changed();
  }

  /** Ends a request for control: the other browser hands control over, or its own request expires. */
  private end(grant: boolean, wasAnswered = false): void {
    if (this.control.requester === null) return;
    const { holder, requester } = this.control;
    const answer = grant ? "control_passed" : "control_kept";
    if (grant || wasAnswered) this.note(answer, holder ?? "", requester);
    else this.note("control_unanswered", requester, holder ?? "");
    if (grant) this.give(requester);
    else this.control = { ...this.control, requester: null };
    this.changed();
  }

  private answer(grant: boolean): void {
    if (!this.hasControl) throw new RequestRefused(say("has_no_control", { name: this.own.name }));
    if (this.control.requester === null) throw new RequestRefused(say("nobody_asks"));
    this.end(grant, true);
  }

  private give(holder: string | null): void {
    clearTimeout(this.timer);
    this.control = { holder, since_s: holder === null ? null : Math.round(Date.now() / 1000), requester: null };
    this.changed();
  }
}
