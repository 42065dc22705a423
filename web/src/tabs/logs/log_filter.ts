/** Which rows of the log are shown, and how they are written. */
import { type Level, type LogRow, type Tail, isWarning } from "./log_store";

export type Severity = "all" | "info" | "warning" | "error";
export const SEVERITIES: readonly Severity[] = ["all", "info", "warning", "error"];

export interface LogFilter {
  severity: Severity;
  /** Empty: all nodes. */
  node: string;
  search: string;
}

const SHOWN: Record<Severity, (level: Level) => boolean> = {
  all: () => true,
  info: (level) => level !== "debug",
  warning: isWarning,
  error: (level) => level === "error" || level === "fatal",
};

/** The rows that pass a filter. Warnings are taken from the separate list of warnings, which reaches further back. */
export function filteredRows({ rows, warnings }: Pick<Tail, "rows" | "warnings">, { severity, node, search }: LogFilter): LogRow[] {
  const wanted = search.trim().toLowerCase();
  const isShown = SHOWN[severity];
  const source = severity === "warning" || severity === "error" ? warnings : rows;
  return source.filter(
    (row) =>
      isShown(row.level) &&
      (node === "" || row.node === node) &&
      (wanted === "" || row.message.toLowerCase().includes(wanted) || row.node.toLowerCase().includes(wanted)),
  );
}

const WALL_CLOCK_S = 1e9;

/** The time of a row: of the day, or of the simulation's clock as minutes and seconds. */
export function rowTime(timeS: number): string {
  const milliseconds = String(Math.floor((timeS % 1) * 1000)).padStart(3, "0");
  if (timeS < WALL_CLOCK_S) return `${two(timeS / 60)}:${two(timeS % 60)}.${milliseconds}`;
  const date = new Date(timeS * 1000);
  return `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}.${milliseconds}`;
}

/** A row as a line of text, to be pasted elsewhere. */
export function rowText({ timeS, level, node, message, place }: LogRow): string {
  return `[${rowTime(timeS)}] [${level.toUpperCase()}] [${node}] ${message}${place === "" ? "" : ` (${place})`}`;
}

function two(value: number): string {
  return String(Math.floor(value)).padStart(2, "0");
}
