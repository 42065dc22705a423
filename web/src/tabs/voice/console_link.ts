/** The page's connection to `/_api/voice`: it announces the operator's turns, and has the console carry out calls. */
import { type MessageSocket, openSocket } from "@/api/sockets";
import { TextError } from "@/i18n/text_error";
import type { FunctionCall } from "./live/server_frame";

export type TurnKind = "speech" | "text" | "button";
export type ToolResult = Record<string, unknown>;

/** Whether the console hears this page's microphone, and if not, why. */
export interface ListenerState {
  state: "off" | "starting" | "ready" | "missing" | "failed" | "busy";
  reason: string;
}

/** What the console listens for, and from which loudness on, 0 to 1. */
export interface Listening {
  mode: "stops" | "commands";
  startLevel: number;
  endLevel: number;
}

/** What came of a sentence to the agent without a model. */
export interface Reply {
  id: string;
  /** For people, in English. */
  message: string;
  call: { tool: string; arguments: Record<string, unknown> } | null;
  response: ToolResult | null;
  /** What waits for a yes; empty if nothing does. */
  readBack: string;
}

/** The state of the session as the console sends it. */
export interface ConsoleState {
  /** Why calls are refused for the rest of the turn; empty if they are not. */
  cutOff: string;
  speedCap: number;
  maxLinearMps: number;
  maxAngularRps: number;
  /** Whether a burst of velocity is running. */
  isDriving: boolean;
  listener: ListenerState;
}

export interface ConsoleListener {
  opened(): void;
  changed(state: ConsoleState): void;
  lost(): void;
  /** Another tab of this browser has the voice agent now. */
  moved(): void;
  /** A word for stopping was heard, and the stop is engaged. */
  stopHeard(text: string): void;
  /** A turn in speech was recognized for the agent without a model; `problem` says why it is not acted on. */
  heard(id: string, text: string, problem: string): void;
  replied(reply: Reply): void;
  /** The sound of a reply. */
  spoken(sound: ArrayBuffer): void;
}

/** What the model is told of a call whose outcome nobody knows. */
const LINK_LOST = "the link to the console was lost before the result came; ask for the state before going on";
const RETRY_AFTER_MS = 1500;
/** A socket that the server closes for another one of the same browser. */
const POLICY_VIOLATION = 1008;
const MAX_CHARACTERS = 1_000_000;
/** Half a second of sound: where the network takes no more, what waits would be too old for a stop. */
const MAX_BUFFERED_BYTES = 16_000;
/** The console would drop each frame. */
const DEAF_STATES: readonly ListenerState["state"][] = ["missing", "failed", "busy"];
const LISTENER_STATES: readonly string[] = ["off", "starting", "ready", "missing", "failed", "busy"] satisfies ListenerState["state"][];

type Fields = Record<string, unknown>;

export class ConsoleLink {
  private socket: MessageSocket | null = null;
  private isOpen = false;
  private isOver = false;
  private pending = new Map<string, (result: ToolResult) => void>();
  private timer: ReturnType<typeof setTimeout> | undefined;
  private listening: Listening | null = null;
  private isHeard = true;

  constructor(
    private readonly url: string,
    private readonly listener: ConsoleListener,
    private readonly open: (url: string) => MessageSocket = openSocket,
  ) {}

  start(): void {
    const socket = this.open(this.url);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    const isCurrent = () => this.socket === socket;
    socket.onopen = () => {
      if (!isCurrent()) return;
      this.isOpen = true;
      this.listener.opened();
      this.requestListening();
    };
    socket.onmessage = ({ data }) => isCurrent() && this.take(data);
    socket.onclose = ({ code }) => isCurrent() && this.lost(code === POLICY_VIOLATION);
  }

  close(): void {
    this.isOver = true;
    clearTimeout(this.timer);
    const { socket } = this;
    this.socket = null;
    this.isOpen = false;
    socket?.close();
    this.giveUpCalls();
  }

  /** Announce a turn of the operator, or its end: only what a person did may be announced here. */
  announceTurn(id: string, by: TurnKind, ended: boolean): void {
    this.send({ turn: { id, by, ended } });
  }

  /** Tell the console that the operator interrupts: a burst ends, and what was read back is forgotten. */
  interrupt(): void {
    this.send({ cancel: true });
  }

  /** Have a call carried out, or refused. Without a link, the result says so. */
  call({ id, name, args }: FunctionCall): Promise<ToolResult> {
    if (!this.isOpen) return Promise.resolve({ ok: false, error: LINK_LOST });
    return new Promise((resolve) => {
      this.pending.set(id, resolve);
      this.send({ call: { id, name, arguments: args } });
    });
  }

  /** Have the console hear the microphone from now on, over each connection; null ends it. */
  listen(listening: Listening | null): void {
    const wasListening = this.listening !== null;
    this.listening = listening;
    if (listening !== null) this.requestListening();
    else if (wasListening) this.send({ listen: { mode: "off" } });
  }

  /** Send a frame of the microphone: 50 ms of mono PCM of 16 bits at 16 kHz. */
  sendSound(frame: Int16Array): void {
    if (this.listening === null || !this.isHeard || !this.isOpen || this.socket === null || this.socket.bufferedAmount > MAX_BUFFERED_BYTES) return;
    this.socket.send(new Int16Array(frame).buffer);
  }

  /** Say a sentence to the agent without a model, as a turn with this id. */
  say(id: string, sentence: string, language: "en" | "nl"): void {
    this.send({ say: { id, text: sentence, language } });
  }

  /** Answer what that agent has read back, by a button. */
  answer(id: string, agrees: boolean): void {
    this.send({ answer: { id, agrees } });
  }

  /** Tell the console whether this page may not move the robot. */
  setClosed(isClosed: boolean): void {
    this.send({ closed: isClosed });
  }

  /** Have the console write in its journal what this page has refused, and why. */
  noteRefusal(name: string, args: Record<string, unknown>, reason: string): void {
    this.send({ refused: { name, arguments: args, reason } });
  }

  private requestListening(): void {
    if (this.listening === null) return;
    const { mode, startLevel, endLevel } = this.listening;
    this.send({ listen: { mode, start_level: startLevel, end_level: endLevel } });
  }

  private send(message: object): void {
    if (this.isOpen) this.socket?.send(JSON.stringify(message));
  }

  private take(data: unknown): void {
    if (data instanceof ArrayBuffer) {
      this.listener.spoken(data);
      return;
    }
    const message = typeof data === "string" && data.length <= MAX_CHARACTERS ? parsed(data) : null;
    const result = fields(message?.["result"]);
    const state = fields(message?.["state"]);
    if (result !== null && typeof result["id"] === "string") {
      const resolve = this.pending.get(result["id"]);
      this.pending.delete(result["id"]);
      resolve?.(fields(result["response"]) ?? { ok: false, error: LINK_LOST });
    }
    if (state !== null) this.changed(readState(state));
    const [heard, reply, stop] = [fields(message?.["heard"]), fields(message?.["reply"]), message?.["stop_heard"]];
    if (typeof stop === "string") this.listener.stopHeard(stop);
    if (heard !== null) this.listener.heard(asText(heard["id"]), asText(heard["text"]), asText(heard["problem"]));
    if (reply !== null) this.listener.replied(readReply(reply));
  }

  private changed(state: ConsoleState): void {
    this.isHeard = !DEAF_STATES.includes(state.listener.state);
    this.listener.changed(state);
  }

  private lost(isMoved: boolean): void {
    const wasOpen = this.isOpen;
    this.isOpen = false;
    this.socket = null;
    this.giveUpCalls();
    if (isMoved && wasOpen) {
      this.isOver = true;
      this.listener.moved();
      return;
    }
    this.listener.lost();
    this.timer = setTimeout(() => !this.isOver && this.start(), RETRY_AFTER_MS);
  }

  private giveUpCalls(): void {
    for (const resolve of this.pending.values()) resolve({ ok: false, error: LINK_LOST });
    this.pending.clear();
  }
}

/** The error of a session that another tab took over. */
export const MOVED = new TextError("voice_fail_moved");

function readState(state: Fields): ConsoleState {
  return {
    cutOff: typeof state["cut_off"] === "string" ? state["cut_off"] : "",
    speedCap: number(state["speed_cap"], 1),
    maxLinearMps: number(state["max_linear_mps"], 0),
    maxAngularRps: number(state["max_angular_rps"], 0),
    isDriving: state["is_driving"] === true,
    listener: readListener(fields(state["listener"]) ?? {}),
  };
}

function readListener({ state, reason }: Fields): ListenerState {
  const isKnown = typeof state === "string" && LISTENER_STATES.includes(state);
  return { state: isKnown ? (state as ListenerState["state"]) : "off", reason: asText(reason) };
}

function readReply(reply: Fields): Reply {
  const call = fields(reply["call"]);
  return {
    id: asText(reply["id"]),
    message: asText(reply["message"]),
    call: call === null ? null : { tool: asText(call["tool"]), arguments: fields(call["arguments"]) ?? {} },
    response: fields(reply["response"]),
    readBack: asText(reply["read_back"]),
  };
}

function asText(value: unknown): string {
  return typeof value === "string" ? value : "";
}

function number(value: unknown, otherwise: number): number {
  return typeof value === "number" && Number.isFinite(value) ? value : otherwise;
}

function parsed(text: string): Fields | null {
  try {
    return fields(JSON.parse(text));
  } catch {
    return null;
  }
}

function fields(value: unknown): Fields | null {
  return typeof value === "object" && value !== null && !Array.isArray(value) ? (value as Fields) : null;
}
