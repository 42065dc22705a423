/** The page's connection to `/_api/voice`: it announces the operator's turns, and has the console carry out calls. */
import { type MessageSocket, openSocket } from "@/api/sockets";
import { TextError } from "@/i18n/text_error";
import type { FunctionCall } from "./live/server_frame";

export type TurnKind = "speech" | "text" | "button";
export type ToolResult = Record<string, unknown>;

/** The state of the session as the console sends it. */
export interface ConsoleState {
  /** Why calls are refused for the rest of the turn; empty if they are not. */
  cutOff: string;
  speedCap: number;
  maxLinearMps: number;
  maxAngularRps: number;
  /** Whether a burst of velocity is running. */
  isDriving: boolean;
}

export interface ConsoleListener {
  opened(): void;
  changed(state: ConsoleState): void;
  lost(): void;
  /** Another tab of this browser has the voice agent now. */
  moved(): void;
}

/** What the model is told of a call whose outcome nobody knows. */
const LINK_LOST = "the link to the console was lost before the result came; ask for the state before going on";
const RETRY_AFTER_MS = 1500;
/** A socket that the server closes for another one of the same browser. */
const POLICY_VIOLATION = 1008;
const MAX_CHARACTERS = 1_000_000;

type Fields = Record<string, unknown>;

export class ConsoleLink {
  private socket: MessageSocket | null = null;
  private isOpen = false;
  private isOver = false;
  private pending = new Map<string, (result: ToolResult) => void>();
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly url: string,
    private readonly listener: ConsoleListener,
    private readonly open: (url: string) => MessageSocket = openSocket,
  ) {}

  start(): void {
    const socket = this.open(this.url);
    this.socket = socket;
    const isCurrent = () => this.socket === socket;
    socket.onopen = () => {
      if (!isCurrent()) return;
      this.isOpen = true;
      this.listener.opened();
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

  private send(message: object): void {
    if (this.isOpen) this.socket?.send(JSON.stringify(message));
  }

  private take(data: unknown): void {
    const message = typeof data === "string" && data.length <= MAX_CHARACTERS ? parsed(data) : null;
    const result = fields(message?.["result"]);
    const state = fields(message?.["state"]);
    if (result !== null && typeof result["id"] === "string") {
      const resolve = this.pending.get(result["id"]);
      this.pending.delete(result["id"]);
      resolve?.(fields(result["response"]) ?? { ok: false, error: LINK_LOST });
    }
    if (state !== null) this.listener.changed(readState(state));
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
  };
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
