/** Calls and their results as short texts. */
import { fixed } from "@/ui/numbers";
import type { CallRow } from "./voice_store";

const MAX_LENGTH = 240;
const PLACES = 3;

export function describeArguments(args: Record<string, unknown>): string {
  return short(fieldTexts(args).join(", "));
}

type Outcome = Pick<CallRow, "state" | "result">;

/** The fields of the result of a call. */
export function describeResult({ result }: Outcome): string {
  const { ok: _, ...fields } = result ?? {};
  return short(fieldTexts(fields).join(", "));
}

/** What is read back, or why a call was refused, with what engages the stop: each a sentence of the console or the robot. */
export function sentencesOf({ state, result }: Outcome): string[] {
  if (result === null) return [];
  if (state === "read_back") return [short(String(result["confirm"]))];
  const reasons = Array.isArray(result["reasons"]) ? result["reasons"] : [];
  return [result["error"], ...reasons].map((each) => short(valueText(each)));
}

function fieldTexts(fields: Record<string, unknown>): string[] {
  return Object.entries(fields).map(([name, value]) => `${name} ${valueText(value)}`);
}

function valueText(value: unknown): string {
  if (typeof value === "string") return value;
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : fixed(value, PLACES);
  if (typeof value === "boolean" || value === null || value === undefined) return value === true ? "yes" : value === false ? "no" : "–";
  if (Array.isArray(value)) return value.length === 0 ? "none" : value.map(valueText).join(", ");
  const fields = value as Record<string, unknown>;
  // Text of the robot, marked as data for the model.
  if (Object.keys(fields).length === 1 && "untrusted" in fields) return valueText(fields["untrusted"]);
  return `(${fieldTexts(fields).join(", ")})`;
}

function short(text: string): string {
  return text.length <= MAX_LENGTH ? text : `${text.slice(0, MAX_LENGTH - 1)}…`;
}
