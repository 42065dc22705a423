/** What the voice session does with a conversation, whether a model answers in it or the console itself. */
import type { Listening } from "./console_link";

export interface Talk {
  start(): void;
  close(): void;
  /** The operator begins to speak; the agent falls silent. */
  beginSpeech(): void;
  /** A frame of the microphone, while the operator is speaking. */
  hear(frame: Int16Array): void;
  endSpeech(): void;
  say(text: string): void;
  /** Carry out what was read back, as the operator has pressed the button. */
  confirm(): void;
  /** Forget what was read back, as the operator has pressed the button. */
  refuse(): void;
  /** End the answer and what the console is doing for it. */
  interrupt(): void;
  /** Fall silent, as at a stop. The microphone goes on. */
  silence(): void;
  /** The player has begun, or has nothing left. */
  playing(isPlaying: boolean): void;
  /** Have the console hear the microphone; null ends it. */
  listen(listening: Listening | null): void;
  /** Have the console write in its journal what this page has refused, and why, in English. */
  noteRefusal(name: string, args: Record<string, unknown>, reason: string): void;
  /** Each frame of the microphone, for the console. */
  overhear(frame: Int16Array): void;
}
