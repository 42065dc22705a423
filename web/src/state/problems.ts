/** What did not work, and what did: short messages that go by themselves. */
import { create } from "zustand";
import { errorText } from "@/i18n/error_text";
import { type TextKey, type TextValues, textIn, useLanguage } from "@/i18n/text";
import { CommandRefused } from "@/safety/guard";

export const MAX_MESSAGES = 4;
const SHOWN_MS = 6000;
const MAX_LENGTH = 300;

export interface Message {
  number: number;
  tone: "problem" | "done";
  text: string;
  /** How often it came while it was shown. */
  count: number;
}

export const useMessages = create<{ messages: Message[] }>(() => ({ messages: [] }));

const timers = new Map<number, ReturnType<typeof setTimeout>>();
let number = 0;

export function showProblem(error: unknown): void {
  const { language } = useLanguage.getState();
  const reason = errorText(error);
  if (error instanceof CommandRefused) {
    show("problem", reason);
    return;
  }
  show("problem", textIn(language, "unknown_error", { reason: reason.slice(0, MAX_LENGTH) }));
}

/** Say what somebody else has done. */
export function showInfo(key: TextKey, values: TextValues): void {
  showDone(textIn(useLanguage.getState().language, key, values));
}

export function showDone(message: string): void {
  show("done", message.slice(0, MAX_LENGTH));
}

/** Show what the robot answered to a request, or why there is no answer; whether it did what was asked. */
export async function showAnswer(request: Promise<{ success: boolean; message: string }>): Promise<boolean> {
  try {
    const answer = await request;
    if (!answer.success) throw new Error(answer.message);
    showDone(answer.message);
    return true;
  } catch (error) {
    showProblem(error);
    return false;
  }
}

export function removeMessage(removed: number): void {
  clearTimeout(timers.get(removed));
  timers.delete(removed);
  useMessages.setState(({ messages }) => ({ messages: messages.filter((each) => each.number !== removed) }));
}

function show(tone: Message["tone"], text: string): void {
  const { messages } = useMessages.getState();
  const same = messages.find((each) => each.tone === tone && each.text === text);
  number += 1;
  const message = { number: same?.number ?? number, tone, text, count: (same?.count ?? 0) + 1 };
  const others = messages.filter((each) => each !== same);
  useMessages.setState({ messages: [...others, message].slice(-MAX_MESSAGES) });
  clearTimeout(timers.get(message.number));
  timers.set(message.number, setTimeout(() => removeMessage(message.number), SHOWN_MS));
}
