/** A conversation with a model of the Live API, over one connection after the other. */
import type { MessageSocket } from "@/api/sockets";
import { TextError } from "@/i18n/text_error";
import { type Close, judgeClose } from "./closes";
import { ACTIVITY_END, ACTIVITY_START, type FunctionResponse, audioMessage, responseMessage, setupMessage, textMessage } from "./client_messages";
import type { LiveModel } from "./models";
import { BadFrame, type ServerFrame, readFrame } from "./server_frame";


export interface LiveListener {
  /** The model listens. `isForgetful`: it knows nothing of what was said before. */
  opened(isForgetful: boolean): void;
  received(frame: ServerFrame): void;
  /** The connection was lost or is being replaced; what is sent now waits. */
  reconnecting(): void;
  /** It is over: the error says why and what to do. */
  failed(error: Error): void;
}

/** A setup is answered within a second; a network that swallows it is found by this. */
const SETUP_TIMEOUT_MS = 12_000;
const RETRY_AFTER_MS = [300, 1000, 2000, 4000];
/** A connection that lasted as long did work. */
const PROVEN_MS = 10_000;
/** What may wait for a connection: some seconds of speech. Older audio is dropped first. */
const MAX_WAITING = 200;
/** How long before its announced end a connection is replaced, even if somebody is speaking. */
const MOVE_BEFORE_MS = 3000;

export class LiveClient {
  private socket: MessageSocket | null = null;
  private isReady = false;
  private isOver = false;
  private isBusy = false;
  /** Whether the operator is speaking. */
  private isActive = false;
  private handle: string | null = null;
  private hasTalked = false;
  private waiting: { text: string; isAudio: boolean }[] = [];
  private failures = 0;
  private mustMove = false;
  private openedMs = 0;
  private timers = new Map<"setup" | "retry" | "move", ReturnType<typeof setTimeout>>();

  /** `open` opens a connection with a credential of its own; it throws what to tell the operator. */
  constructor(
    private readonly open: () => Promise<MessageSocket>,
    private readonly model: LiveModel,
    private readonly instruction: () => string,
    private readonly listener: LiveListener,
  ) {}

  start(): void {
    void this.connect();
  }

  close(): void {
    this.isOver = true;
    this.drop();
    for (const timer of this.timers.values()) clearTimeout(timer);
    this.waiting = [];
  }

  beginActivity(): void {
    this.isActive = true;
    this.send(ACTIVITY_START);
  }

  endActivity(): void {
    this.isActive = false;
    this.send(ACTIVITY_END);
  }

  sendAudio(base64: string): void {
    this.send(audioMessage(base64), true);
  }

  sendText(text: string): void {
    this.send(textMessage(text));
  }

  respond(responses: readonly FunctionResponse[]): void {
    // A new connection does not know the calls of the last one.
    if (this.isReady && responses.length > 0) this.send(responseMessage(responses));
  }

  /** Note whether a turn is going on: a connection that is about to end is replaced between two of them. */
  setBusy(isBusy: boolean): void {
    this.isBusy = isBusy;
    if (!isBusy && this.mustMove) this.move();
  }

  private send(message: object, isAudio = false): void {
    if (this.isOver) return;
    this.hasTalked = true;
    const text = JSON.stringify(message);
    if (this.isReady) {
      this.socket?.send(text);
      return;
    }
    this.waiting.push({ text, isAudio });
    if (this.waiting.length <= MAX_WAITING) return;
    const oldest = this.waiting.findIndex((each) => each.isAudio);
    this.waiting.splice(Math.max(0, oldest), 1);
  }

  private async connect(): Promise<void> {
    this.mustMove = false;
    let socket: MessageSocket;
    try {
      socket = await this.open();
    } catch (error) {
      this.fail(error instanceof Error ? error : new Error(String(error)));
      return;
    }
    if (this.isOver) {
      socket.close();
      return;
    }
    const handle = this.handle;
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    const isCurrent = () => this.socket === socket;
    socket.onopen = () => isCurrent() && socket.send(JSON.stringify(setupMessage(this.model, this.instruction(), handle)));
    socket.onmessage = ({ data }) => isCurrent() && this.take(data, handle);
    socket.onclose = ({ code, reason }) => isCurrent() && this.lost(judgeClose(code, reason, handle !== null && !this.isReady));
    this.after("setup", SETUP_TIMEOUT_MS, () => {
      this.drop();
      this.lost(judgeClose(1006, "", false));
    });
  }

  private take(data: unknown, handle: string | null): void {
    let frame: ServerFrame;
    try {
      frame = readFrame(data);
    } catch (error) {
      if (!(error instanceof BadFrame)) throw error;
      this.fail(new TextError("voice_fail_frame", { reason: error.message }));
      return;
    }
    if (frame.isSetupComplete && !this.isReady) this.ready(handle);
    if (frame.handle !== null) this.handle = frame.handle;
    if (frame.endsInMs !== null) this.moveWithin(frame.endsInMs - MOVE_BEFORE_MS);
    this.listener.received(frame);
  }

  private ready(handle: string | null): void {
    this.end("setup");
    this.isReady = true;
    this.openedMs = performance.now();
    const wasForgotten = handle === null && this.hasTalked && this.failures > 0;
    const { waiting } = this;
    this.waiting = [];
    for (const { text } of waiting) this.socket?.send(text);
    if (this.model.moveAfterMs !== null) this.after("move", this.model.moveAfterMs, () => this.moveWithin(60_000));
    this.listener.opened(wasForgotten);
  }

  private lost({ next, error }: Close): void {
    if (this.isReady && performance.now() - this.openedMs > PROVEN_MS) this.failures = 0;
    this.drop();
    const waitMs = RETRY_AFTER_MS[this.failures];
    if (next === "fail" || waitMs === undefined) {
      this.fail(error);
      return;
    }
    if (next === "renew") this.handle = null;
    this.failures += 1;
    this.listener.reconnecting();
    this.after("retry", waitMs, () => void this.connect());
  }

  /** Replace the connection at the next pause, and after `latestMs` in any case. */
  private moveWithin(latestMs: number): void {
    if (this.handle === null) return; // it ends by itself, and the conversation begins anew
    this.mustMove = true;
    if (!this.isBusy) this.move();
    else this.after("move", Math.max(0, latestMs), () => this.move());
  }

  private move(): void {
    this.drop();
    this.listener.reconnecting();
    void this.connect();
  }

  /** Leave the present connection: nothing of it is heard any more. */
  private drop(): void {
    this.end("setup");
    this.end("move");
    const { socket } = this;
    // The next connection does not know that an utterance has begun.
    if (this.isReady && this.isActive) this.waiting.push({ text: JSON.stringify(ACTIVITY_START), isAudio: false });
    this.socket = null;
    this.isReady = false;
    socket?.close();
  }

  private fail(error: Error): void {
    if (this.isOver) return;
    this.close();
    this.listener.failed(error);
  }

  private after(name: "setup" | "retry" | "move", waitMs: number, act: () => void): void {
    this.end(name);
    this.timers.set(name, setTimeout(act, waitMs));
  }

  private end(name: "setup" | "retry" | "move"): void {
    clearTimeout(this.timers.get(name));
  }
}
