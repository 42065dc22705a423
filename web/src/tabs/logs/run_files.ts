/** The files of stored runs: which runs there are, their processes' logs, and the command journal. */
import { refused, request, unanswered } from "@/api/http";

export interface StoredRun {
  id: string;
  state: string;
  startedS: number | null;
}

export interface JournalRow {
  /** ms since 1970; NaN if the journal has no time. */
  timeMs: number;
  session: string;
  what: string;
  detail: string;
  /** Why it was refused; empty if it was allowed. */
  refused: string;
  repeats: number;
}

const TIMEOUT_MS = 15_000;

/** GET a text of the API. Throws ApiError. */
export async function askText(path: string): Promise<string> {
  let response: Response;
  try {
    response = await request(path, { signal: AbortSignal.timeout(TIMEOUT_MS) });
  } catch (error) {
    throw unanswered(error);
  }
  const text = await response.text();
  if (!response.ok) throw refused(response.status, text.trim());
  return text;
}

export function parseRuns(answer: unknown): StoredRun[] {
  return objects(answer)
    .map(({ id, state, started_s: started }) => ({ id: textOf(id), state: textOf(state), startedS: typeof started === "number" ? started : null }))
    .filter(({ id }) => id !== "");
}

export function parseNames(answer: unknown): string[] {
  return Array.isArray(answer) ? answer.filter((name): name is string => typeof name === "string") : [];
}

/** The journal, newest first. */
export function parseJournal(answer: unknown): JournalRow[] {
  return objects(answer)
    .map((row) => ({
      timeMs: Date.parse(textOf(row["time"])),
      session: textOf(row["session"]),
      what: textOf(row["what"]),
      detail: textOf(row["detail"]),
      refused: textOf(row["refused"]),
      repeats: typeof row["repeats"] === "number" ? row["repeats"] : 0,
    }))
    .toReversed();
}

export type LineTone = "plain" | "warning" | "error";

export interface TextLine {
  number: number;
  text: string;
  tone: LineTone;
}

// Escape sequences with which programs color their terminal.
const ESCAPES = new RegExp(`${String.fromCharCode(27)}\\[[0-9;?]*[ -/]*[@-~]`, "g");
const HEAD_LENGTH = 120;

/** The lines of a log file, without colors of a terminal. The first line may be cut: the server sends the file's end. */
export function logLines(text: string): TextLine[] {
  const lines = text.replace(ESCAPES, "").split(/\r?\n/);
  if (lines.at(-1) === "") lines.pop();
  return lines.map((line, index) => ({ number: index + 1, text: line, tone: toneOf(line.slice(0, HEAD_LENGTH)) }));
}

function toneOf(head: string): LineTone {
  if (/\b(ERROR|FATAL|CRITICAL|Traceback|\w+Error:)/.test(head)) return "error";
  return /\b(WARN|WARNING)\b/.test(head) ? "warning" : "plain";
}

function objects(answer: unknown): Record<string, unknown>[] {
  return Array.isArray(answer) ? answer.filter((each): each is Record<string, unknown> => typeof each === "object" && each !== null) : [];
}

function textOf(value: unknown): string {
  return typeof value === "string" ? value : "";
}
