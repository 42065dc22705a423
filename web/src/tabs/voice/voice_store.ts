/** What the Voice tab shows of the conversation. */
import { create } from "zustand";
import type { ConsoleState, ToolResult } from "./console_link";

export const MAX_ENTRIES = 80;
export const MAX_CALLS = 40;
/** As long as the console accepts a confirmation. */
export const CONFIRM_WITHIN_MS = 30_000;

export interface Entry {
  number: number;
  /** The operator, the model, what the model wrote by its tool `speak`, or the page. */
  who: "operator" | "agent" | "note" | "page";
  text: string;
  /** Whether more of it is to come. */
  isOpen: boolean;
}

export interface CallRow {
  id: string;
  tool: string;
  args: Record<string, unknown>;
  state: "running" | "done" | "refused" | "read_back" | "cancelled";
  result: ToolResult | null;
  /** Whether the operator's button called it, and not the model. */
  byOperator: boolean;
}

export interface ReadBack {
  tool: string;
  args: Record<string, unknown>;
  /** In the console's words. */
  sentence: string;
  confirmation: string;
  expiresMs: number;
}

/** Times of the last turn, from the end of what the operator said; null for what did not come. */
export interface Latency {
  soundMs: number | null;
  callMs: number | null;
}

export interface VoiceView {
  session: "off" | "connecting" | "on";
  /** Whether a script answers, and no model. */
  isScripted: boolean;
  /** Whether the link to the console is open. */
  isConsoleOpen: boolean;
  console: ConsoleState | null;
  microphone: "off" | "on";
  /** Whether what is said is not understood, only what is typed; words for stopping are heard all the same. */
  isTypedOnly: boolean;
  /** Why there is no microphone. */
  microphoneProblem: Error | null;
  isOperatorSpeaking: boolean;
  isThinking: boolean;
  isAgentSpeaking: boolean;
  /** Why the last session ended by itself. */
  failure: Error | null;
  readBack: ReadBack | null;
  latency: Latency | null;
  transcript: readonly Entry[];
  calls: readonly CallRow[];
  /** Of the microphone, 0 to 1. */
  loudness: number;
}

export const EMPTY_VIEW: VoiceView = {
  session: "off",
  isScripted: false,
  isConsoleOpen: false,
  console: null,
  microphone: "off",
  isTypedOnly: false,
  microphoneProblem: null,
  isOperatorSpeaking: false,
  isThinking: false,
  isAgentSpeaking: false,
  failure: null,
  readBack: null,
  latency: null,
  transcript: [],
  calls: [],
  loudness: 0,
};

export const useVoice = create<VoiceView>(() => EMPTY_VIEW);

let lastNumber = 0;

/** Append to the open entry of somebody, or begin one. */
export function extended(transcript: readonly Entry[], who: Entry["who"], text: string): readonly Entry[] {
  const open = transcript.findLast((entry) => entry.isOpen && entry.who === who);
  if (open === undefined) return withEntry(transcript, who, text.trimStart(), true);
  return transcript.map((entry) => (entry === open ? { ...entry, text: (entry.text + text).trimStart() } : entry));
}

export function withEntry(transcript: readonly Entry[], who: Entry["who"], text: string, isOpen = false): readonly Entry[] {
  lastNumber += 1;
  return [...transcript, { number: lastNumber, who, text, isOpen }].slice(-MAX_ENTRIES);
}

/** Close what was said so far: what comes next is another entry. */
export function closed(transcript: readonly Entry[]): readonly Entry[] {
  return transcript.some(({ isOpen }) => isOpen) ? transcript.map((entry) => (entry.isOpen ? { ...entry, isOpen: false } : entry)) : transcript;
}

export function withCall(calls: readonly CallRow[], call: CallRow): readonly CallRow[] {
  return [...calls, call].slice(-MAX_CALLS);
}

export function withResult(calls: readonly CallRow[], id: string, change: Partial<CallRow>): readonly CallRow[] {
  return calls.map((call) => (call.id === id ? { ...call, ...change } : call));
}

/** What came of a call, by its result. */
export function outcome(result: ToolResult): CallRow["state"] {
  if (result["ok"] === true) return "done";
  return typeof result["confirm"] === "string" ? "read_back" : "refused";
}
