/**
 * A client of the rosbridge protocol, version 2, for one browser and one server.
 *
 * It differs from roslib in what matters beside a robot: nothing is queued while the link is down, so that no command of the
 * past is sent when it returns; subscriptions are restored; samples come as CBOR, with typed arrays and NaN.
 */
import { decode } from "cbor2";
import { WordedError } from "@/i18n/text_error";

export const RECONNECT_FIRST_MS = 500;
export const RECONNECT_LONGEST_MS = 5000;
/** A cut network answers an attempt to connect with silence, and browsers wait for minutes. */
export const CONNECT_TIMEOUT_MS = 5000;
const CALL_TIMEOUT_MS = 10_000;

export interface Socket {
  binaryType: string;
  readyState: number;
  onopen: (() => void) | null;
  onclose: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  send(text: string): void;
  close(): void;
}

export type LinkState = "connecting" | "open" | "lost";

export interface SubscribeOptions {
  /** Shortest time between two samples; 0: all. */
  throttleMs?: number;
  /** Samples that the server keeps for a slow client. */
  queueLength?: number;
}

interface Subscription {
  topic: string;
  type: string;
  options: SubscribeOptions;
  deliver: (message: unknown) => void;
}

interface Call {
  answer: (values: unknown) => void;
  fail: (error: Error) => void;
  timer: ReturnType<typeof setTimeout>;
}

interface GoalCall {
  feedback: (values: unknown) => void;
  result: (values: unknown, status: number) => void;
  fail: (error: Error) => void;
}

export interface GoalHandle<Result> {
  result: Promise<{ result: Result; status: number }>;
  cancel: () => void;
}

export class LinkLost extends WordedError {}
export class CallFailed extends WordedError {}

type Frame = Record<string, unknown> & { op: string };

const OPEN = 1;

export class Rosbridge {
  /** Called with every change of the link's state. */
  onState: (state: LinkState) => void = () => {};
  /** Called with what the server reports without having been asked, such as a refused publication; `id` is that of its cause, or "". */
  onStatus: (level: string, text: string, id: string) => void = () => {};

  private socket: Socket | null = null;
  private subscriptions = new Map<string, Subscription>();
  private advertised = new Set<string>();
  private calls = new Map<string, Call>();
  private goals = new Map<string, GoalCall>();
  private number = 0;
  private waitMs = RECONNECT_FIRST_MS;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private closed = false;
  private frames = 0;

  constructor(private readonly openSocket: () => Socket) {}

  get isOpen(): boolean {
    return this.socket?.readyState === OPEN;
  }

  /** How many frames have arrived so far. */
  get received(): number {
    return this.frames;
  }

  connect(): void {
    this.closed = false;
    clearTimeout(this.timer);
    this.onState("connecting");
    let socket: Socket;
    try {
      socket = this.openSocket();
    } catch {
      this.reconnectLater();
      return;
    }
    this.socket = socket;
    this.timer = setTimeout(() => this.giveUp(socket), CONNECT_TIMEOUT_MS);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.opened(socket);
    socket.onclose = () => this.lost(socket);
    socket.onmessage = (event) => {
      this.frames += 1;
      this.take(event.data);
    };
  }

  /** End the link for good. */
  close(): void {
    this.closed = true;
    clearTimeout(this.timer);
    this.socket?.close();
  }

  /** Drop the link and connect again now, as when the browser reports that its network is back. */
  reconnectNow(): void {
    this.waitMs = RECONNECT_FIRST_MS;
    if (this.isOpen) return;
    const stale = this.socket;
    this.socket = null;
    stale?.close();
    this.connect();
  }

  /** Give up a link on which nothing arrives: after a cut of the network, the browser itself notices nothing for minutes. */
  drop(): void {
    if (this.socket !== null && this.isOpen) this.giveUp(this.socket);
  }

  private giveUp(silent: Socket): void {
    if (silent !== this.socket) return;
    this.lost(silent);
    silent.close();
  }

  private opened(socket: Socket): void {
    if (socket !== this.socket) return;
    clearTimeout(this.timer);
    this.waitMs = RECONNECT_FIRST_MS;
    this.send({ op: "set_level", level: "warning" });
    for (const [id, subscription] of this.subscriptions) this.send(subscribeFrame(id, subscription));
    this.onState("open");
  }

  private lost(socket: Socket): void {
    if (socket !== this.socket) return;
    this.socket = null;
    this.advertised.clear();
    const error = new LinkLost({ key: "error_link_lost" });
    for (const call of this.calls.values()) {
      clearTimeout(call.timer);
      call.fail(error);
    }
    for (const goal of this.goals.values()) goal.fail(error);
    this.calls.clear();
    this.goals.clear();
    this.onState("lost");
    if (!this.closed) this.reconnectLater();
  }

  private reconnectLater(): void {
    this.timer = setTimeout(() => this.connect(), this.waitMs);
    this.waitMs = Math.min(this.waitMs * 2, RECONNECT_LONGEST_MS);
  }

  private take(data: unknown): void {
    let frame: Frame;
    try {
      frame = (typeof data === "string" ? JSON.parse(data) : decode(new Uint8Array(data as ArrayBuffer))) as Frame;
    } catch {
      this.onStatus("error", "the server sent a frame that cannot be read", "");
      return;
    }
    if (frame === null || typeof frame !== "object") return;
    const id = typeof frame["id"] === "string" ? frame["id"] : "";
    switch (frame.op) {
      case "publish":
        this.deliver(frame);
        break;
      case "service_response":
        this.answered(id, frame);
        break;
      case "action_feedback":
        this.goals.get(id)?.feedback(frame["values"]);
        break;
      case "action_result":
        this.finished(id, frame);
        break;
      case "status":
        this.onStatus(String(frame["level"] ?? ""), String(frame["msg"] ?? ""), id);
        break;
    }
  }

  private deliver(frame: Frame): void {
    for (const subscription of this.subscriptions.values()) {
      if (subscription.topic === frame["topic"]) subscription.deliver(frame["msg"]);
    }
  }

  private answered(id: string, frame: Frame): void {
    const call = this.calls.get(id);
    if (call === undefined) return;
    this.calls.delete(id);
    clearTimeout(call.timer);
    if (frame["result"] === true) call.answer(frame["values"]);
    else call.fail(new CallFailed(typeof frame["values"] === "string" ? frame["values"] : JSON.stringify(frame["values"])));
  }

  private finished(id: string, frame: Frame): void {
    const goal = this.goals.get(id);
    if (goal === undefined) return;
    this.goals.delete(id);
    if (frame["result"] === true) goal.result(frame["values"], Number(frame["status"] ?? 0));
    else goal.fail(new CallFailed(typeof frame["values"] === "string" ? frame["values"] : JSON.stringify(frame["values"])));
  }

  private send(frame: Frame): boolean {
    if (!this.isOpen || this.socket === null) return false;
    this.socket.send(JSON.stringify(frame));
    return true;
  }

  private nextId(kind: string): string {
    this.number += 1;
    return `${kind}:${this.number}`;
  }

  /** Subscribe; the returned function ends it. The subscription outlives reconnects. */
  subscribe(topic: string, type: string, options: SubscribeOptions, deliver: (message: unknown) => void): () => void {
    const id = this.nextId("subscribe");
    const subscription = { topic, type, options, deliver };
    this.subscriptions.set(id, subscription);
    this.send(subscribeFrame(id, subscription));
    return () => {
      if (this.subscriptions.delete(id)) this.send({ op: "unsubscribe", id, topic });
    };
  }

  /** Publish now; returns false where the link is down, and then nothing is ever sent. `id` comes back with what the server says of it. */
  publish(topic: string, type: string, message: unknown, id?: string): boolean {
    if (!this.isOpen) return false;
    if (!this.advertised.has(topic)) {
      this.send({ op: "advertise", topic, type });
      this.advertised.add(topic);
    }
    return this.send({ op: "publish", id, topic, msg: message });
  }

  /** Call a service. Rejects with LinkLost, or with CallFailed and the server's reason. */
  call(service: string, type: string, request: unknown, timeoutMs = CALL_TIMEOUT_MS): Promise<unknown> {
    const id = this.nextId("call");
    return new Promise((answer, fail) => {
      const timer = setTimeout(() => {
        this.calls.delete(id);
        fail(new CallFailed({ key: "error_no_answer", values: { service, seconds: timeoutMs / 1000 } }));
      }, timeoutMs);
      this.calls.set(id, { answer, fail, timer });
      if (!this.send({ op: "call_service", id, service, type, args: request, timeout: timeoutMs / 1000 })) {
        this.calls.delete(id);
        clearTimeout(timer);
        fail(new LinkLost({ key: "error_not_connected" }));
      }
    });
  }

  /** Send a goal of an action. The result rejects as `call` does. */
  sendGoal<Result>(action: string, type: string, goal: unknown, feedback: (values: unknown) => void): GoalHandle<Result> {
    const id = this.nextId("goal");
    const result = new Promise<{ result: Result; status: number }>((resolve, fail) => {
      this.goals.set(id, { feedback, fail, result: (values, status) => resolve({ result: values as Result, status }) });
      if (!this.send({ op: "send_action_goal", id, action, action_type: type, args: goal, feedback: true })) {
        this.goals.delete(id);
        fail(new LinkLost({ key: "error_not_connected" }));
      }
    });
    return { result, cancel: () => void this.send({ op: "cancel_action_goal", id, action }) };
  }
}

function subscribeFrame(id: string, { topic, type, options }: Subscription): Frame {
  const frame: Frame = { op: "subscribe", id, topic, type, compression: "cbor" };
  if (options.throttleMs) frame["throttle_rate"] = options.throttleMs;
  if (options.queueLength) frame["queue_length"] = options.queueLength;
  return frame;
}
