/**
 * A server in the page that speaks the protocol of the Live API and follows a script: for the mock mode, and for a page without a key.
 * Its own script only reads the robot's state. It hears nothing and understands nothing.
 */
import type { MessageSocket } from "@/api/sockets";
import { type TextKey, type TextValues, textIn, useLanguage } from "@/i18n/text";
import { fixed } from "@/ui/numbers";
import { PageSocket, type PageServer } from "./page_socket";

type Fields = Record<string, unknown>;

interface Call {
  name: string;
  args: Fields;
}

/** What happens at a turn of the operator: calls, one after the other, then what is said of the last result. */
export interface Step {
  /** The next call, by the results so far; null if it has enough of them. */
  call: (results: readonly Fields[]) => Call | null;
  say: (result: Fields) => string;
  /** How the connection ends instead of an answer. */
  close?: { code: number; reason: string };
  /** Whether the server announces the end of the connection. */
  goesAway?: boolean;
}

const THINKS_MS = 500;
const PIECE_MS = 120;
const RATE_HZ = 24_000;
const TONE_HZ = 330;
/** The tone lasts a little longer than its words take to come. */
const TONE_MORE_MS = 400;

/** The script of a page without a key: it must not move a robot that may be real. */
const STATE_SCRIPT: readonly Step[] = [
  {
    call: (results) => (results.length === 0 ? { name: "query_state", args: {} } : null),
    say: ({ pose, battery }) => {
      const { x, y } = fields(pose);
      const percentage = fields(battery)["percentage"];
      if (typeof x !== "number" || typeof y !== "number" || typeof percentage !== "number") return says("voice_says_unknown");
      return says("voice_says_state", { percent: fixed(percentage <= 1 ? percentage * 100 : percentage, 0), x: fixed(x, 1), y: fixed(y, 1) });
    },
  },
  {
    call: (results) => (results.length === 0 ? { name: "query_state", args: { fields: ["estop"] } } : null),
    say: ({ estop }) => says(fields(estop)["active"] === true ? "voice_says_stopped" : "voice_says_free"),
  },
];

/** Open a connection to the script. `handle` of an earlier connection lets it go on where that one was. */
export function openScriptedAgent(script: readonly Step[] = STATE_SCRIPT): MessageSocket {
  return new PageSocket((socket) => new ScriptedAgent(socket, script));
}

/** How far the script has come, by the handle of its connections. */
const progress = new Map<string, number>();
let handles = 0;

class ScriptedAgent implements PageServer {
  private turns = 0;
  private results: Fields[] = [];
  private step: Step | null = null;
  private calls = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private handle = "";

  constructor(
    private readonly socket: PageSocket,
    private readonly script: readonly Step[],
  ) {}

  opened(): void {}

  closed(): void {
    clearTimeout(this.timer);
  }

  received(text: string): void {
    const message = JSON.parse(text) as Fields;
    const { activityStart, activityEnd } = fields(message["realtimeInput"]);
    if ("setup" in message) this.begin(fields(fields(message["setup"])["sessionResumption"])["handle"]);
    if (activityStart !== undefined) this.interrupt();
    if (activityEnd !== undefined || "clientContent" in message) this.answer();
    const responses = fields(message["toolResponse"])["functionResponses"];
    if (Array.isArray(responses)) this.goOn(fields(fields(responses[0])["response"]));
  }

  private begin(handle: unknown): void {
    this.turns = typeof handle === "string" ? (progress.get(handle) ?? 0) : 0;
    this.socket.deliver({ setupComplete: {} });
    this.renewHandle();
  }

  private renewHandle(): void {
    handles += 1;
    this.handle = `script-${handles}`;
    progress.set(this.handle, this.turns);
    this.socket.deliver({ sessionResumptionUpdate: { newHandle: this.handle, resumable: true } });
  }

  private interrupt(): void {
    clearTimeout(this.timer);
    if (this.step !== null) this.socket.deliver({ serverContent: { interrupted: true } });
    this.step = null;
  }

  private answer(): void {
    this.interrupt();
    const step = this.script[this.turns % this.script.length];
    if (step === undefined) return;
    this.turns += 1;
    this.step = step;
    this.results = [];
    this.timer = setTimeout(() => {
      if (step.close === undefined) this.goOn(null);
      else this.socket.closeWith(step.close.code, step.close.reason);
    }, THINKS_MS);
  }

  private goOn(result: Fields | null): void {
    const { step } = this;
    if (step === null) return;
    if (result !== null) this.results.push(result);
    const call = step.call(this.results);
    if (call === null) {
      this.say(step.say(this.results.at(-1) ?? {}), step.goesAway === true);
      return;
    }
    this.calls += 1;
    this.socket.deliver({ toolCall: { functionCalls: [{ id: `${this.handle}-${this.calls}`, ...call }] } });
  }

  private say(sentence: string, goesAway: boolean): void {
    const pieces = sentence.split(/(?<= )/);
    const next = () => {
      const piece = pieces.shift();
      if (piece === undefined) {
        this.step = null;
        this.socket.deliver({ serverContent: { turnComplete: true } });
        this.renewHandle();
        if (goesAway) this.socket.deliver({ goAway: { timeLeft: "30s" } });
        return;
      }
      this.socket.deliver({ serverContent: { outputTranscription: { text: piece } } });
      this.timer = setTimeout(next, PIECE_MS);
    };
    const data = tone((pieces.length * PIECE_MS + TONE_MORE_MS) / 1000);
    this.socket.deliver({ serverContent: { modelTurn: { parts: [{ inlineData: { mimeType: `audio/pcm;rate=${RATE_HZ}`, data } }] } } });
    next();
  }
}

/** A soft tone as PCM of 16 bits, in base64. */
function tone(seconds: number): string {
  const count = Math.round(RATE_HZ * seconds);
  const bytes = new Uint8Array(2 * count);
  const view = new DataView(bytes.buffer);
  for (let index = 0; index < count; index += 1) {
    const fade = Math.sin((Math.PI * index) / count);
    view.setInt16(2 * index, Math.round(3000 * fade * Math.sin((2 * Math.PI * TONE_HZ * index) / RATE_HZ)), true);
  }
  let text = "";
  for (const byte of bytes) text += String.fromCharCode(byte);
  return btoa(text);
}

/** A text of the catalog, in the language of the page. */
export function says(key: TextKey, values: TextValues = {}): string {
  return textIn(useLanguage.getState().language, key, values);
}

function fields(value: unknown): Fields {
  return typeof value === "object" && value !== null && !Array.isArray(value) ? (value as Fields) : {};
}
