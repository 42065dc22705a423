/** Calls and their results as short texts. */
import { fixed } from "@/ui/numbers";
import type { CallRow } from "./voice_store";

const MAX_LENGTH = 240;
const PLACES = 3;

export function describeArguments(args: Record<string, unknown>): string {
  return short(fieldTexts(args).join(", "));
}

/** What came of a call: the fields of its result, or why it was refused. */
export function describeResult({ state, result }: Pick<CallRow, "state" | "result">): string {
  if (result === null) return "";
  if (state === "read_back") return short(String(result["confirm"]));
  if (state === "refused") {
    const reasons = Array.isArray(result["reasons"]) ? result["reasons"].map(valueText).join(", ") : "";
    const error = typeof result["error"] === "string" ? result["error"] : valueText(result["error"]);
    return short(reasons === "" ? error : `${error} (${reasons})`);
  }
  const { ok: _, ...fields } = result;
  return short(fieldTexts(fields).join(", "));
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
