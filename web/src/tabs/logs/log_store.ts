/**
 * The tail of the log: the newest rows of all, and the newest warnings apart, so that a flood of debug lines does not push them
 * out. However many lines arrive, the page is updated at most once per frame, and memory stays constant.
 */
import { rcl_interfaces_Log as LEVELS, type rcl_interfaces_Log as Log } from "@/generated/messages";

export const MAX_ROWS = 500;
const MAX_NODES = 200;
const MAX_MESSAGE = 4000;

export type Level = "debug" | "info" | "warning" | "error" | "fatal";

export interface LogRow {
  /** Rises with every row. */
  id: number;
  level: Level;
  node: string;
  message: string;
  /** The stamp in s: since 1970, or of the simulation's clock. */
  timeS: number;
  /** file:line and function; empty if the message has none. */
  place: string;
}

export interface Tail {
  rows: readonly LogRow[];
  /** Warnings and worse only. */
  warnings: readonly LogRow[];
  /** All rows since the beginning or the last clearing. */
  received: number;
  /** The nodes that have logged something, by name. */
  nodes: readonly string[];
  /** performance.now() of the newest row; null without one. */
  lastMs: number | null;
}

const EMPTY: Tail = { rows: [], warnings: [], received: 0, nodes: [], lastMs: null };

export class LogStore {
  tail: Tail = EMPTY;
  private pending: LogRow[] = [];
  private pendingWarnings: LogRow[] = [];
  private count = 0;
  private received = 0;
  private lastMs: number | null = null;
  private readonly nodes = new Set<string>();
  private isScheduled = false;
  private readonly listeners = new Set<() => void>();

  /** `schedule` calls its argument at one of the next frames. */
  constructor(private readonly schedule: (flush: () => void) => void) {}

  add(message: Partial<Log>, receivedMs: number): void {
    this.count += 1;
    this.received += 1;
    this.lastMs = receivedMs;
    const row = rowOf(message, this.count);
    keepNewest(this.pending, row);
    if (isWarning(row.level)) keepNewest(this.pendingWarnings, row);
    if (this.nodes.size < MAX_NODES) this.nodes.add(row.node);
    if (this.isScheduled) return;
    this.isScheduled = true;
    this.schedule(() => this.flush());
  }

  clear(): void {
    this.pending = [];
    this.pendingWarnings = [];
    this.received = 0;
    this.nodes.clear();
    this.tail = EMPTY;
    this.tell();
  }

  readonly subscribe = (listener: () => void): (() => void) => {
    this.listeners.add(listener);
    return () => void this.listeners.delete(listener);
  };

  private flush(): void {
    this.isScheduled = false;
    const { nodes, rows, warnings } = this.tail;
    this.tail = {
      rows: newest(rows, this.pending),
      warnings: newest(warnings, this.pendingWarnings),
      received: this.received,
      nodes: nodes.length === this.nodes.size ? nodes : [...this.nodes].toSorted((a, b) => a.localeCompare(b)),
      lastMs: this.lastMs,
    };
    this.pending = [];
    this.pendingWarnings = [];
    this.tell();
  }

  private tell(): void {
    for (const listener of this.listeners) listener();
  }
}

function newest(rows: readonly LogRow[], added: readonly LogRow[]): readonly LogRow[] {
  if (added.length === 0) return rows;
  return [...rows, ...added].slice(-MAX_ROWS);
}

/** A hidden page draws no frames; this timer then keeps the list short. */
function keepNewest(rows: LogRow[], row: LogRow): void {
  rows.push(row);
  if (rows.length >= 2 * MAX_ROWS) rows.splice(0, rows.length - MAX_ROWS);
}

function rowOf({ level, name, msg, stamp, file, function: where, line }: Partial<Log>, id: number): LogRow {
  return {
    id,
    level: levelOf(level ?? 0),
    node: name ?? "",
    message: (msg ?? "").slice(0, MAX_MESSAGE),
    timeS: (stamp?.sec ?? 0) + (stamp?.nanosec ?? 0) / 1e9,
    place: file ? `${file}:${line ?? 0}${where ? ` ${where}` : ""}` : "",
  };
}

/** The level of a number: between two levels it is the lower one. */
export function levelOf(level: number): Level {
  if (level >= LEVELS.FATAL) return "fatal";
  if (level >= LEVELS.ERROR) return "error";
  if (level >= LEVELS.WARN) return "warning";
  return level >= LEVELS.INFO ? "info" : "debug";
}

export function isWarning(level: Level): boolean {
  return level === "warning" || level === "error" || level === "fatal";
}
