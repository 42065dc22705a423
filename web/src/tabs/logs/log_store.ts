/**
 * The tail of the log: the newest rows of all, and the newest warnings apart, so that a flood of debug lines does not push them
 * out. It begins with the run's history, which the server has. However many lines arrive, the page is updated at most once per frame, and memory stays constant.
 */
import { RecentKeys } from "@/map/recent_keys";
import { rcl_interfaces_Log as LEVELS, type rcl_interfaces_Log as Log } from "@/generated/messages";

/** As many as the server's history has. */
export const MAX_ROWS = 2500;
const MAX_NODES = 200;
const MAX_MESSAGE = 4000;
const MAX_KNOWN = 2 * MAX_ROWS;
/** Characters of a message that tell it from others of the same time. */
const KEY_LENGTH = 200;

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
  /** What was shown, also before a clearing: the history does not bring it again. */
  private readonly known = new RecentKeys(MAX_KNOWN);
  /** What came with the history, and may still come live. */
  private past = new Set<string>();
  private readonly listeners = new Set<() => void>();

  /** `schedule` calls its argument at one of the next frames. */
  constructor(private readonly schedule: (flush: () => void) => void) {}

  add(message: Partial<Log>, receivedMs: number): void {
    this.count += 1;
    this.lastMs = receivedMs;
    const row = rowOf(message, this.count);
    const key = keyOf(row);
    this.known.add(key);
    if (this.past.delete(key)) return;
    this.received += 1;
    keepNewest(this.pending, row);
    if (isWarning(row.level)) keepNewest(this.pendingWarnings, row);
    if (this.nodes.size < MAX_NODES) this.nodes.add(row.node);
    if (this.isScheduled) return;
    this.isScheduled = true;
    this.schedule(() => this.flush());
  }

  /** Put lines of the past where they belong by their time, those that are known already left out. */
  addPast(messages: readonly Partial<Log>[]): void {
    this.flush();
    const fresh = messages.map((message) => rowOf(message, 0)).filter((row) => this.known.add(keyOf(row)));
    if (fresh.length === 0) return;
    this.past = new Set(fresh.map(keyOf));
    this.received += fresh.length;
    for (const { node } of fresh) if (this.nodes.size < MAX_NODES) this.nodes.add(node);
    const rows = [...new Set([...this.tail.rows, ...this.tail.warnings, ...fresh])]
      .toSorted((a, b) => a.timeS - b.timeS)
      .map((row, index) => ({ ...row, id: this.count + index + 1 }));
    this.count += rows.length;
    this.tail = { ...this.tail, rows: rows.slice(-MAX_ROWS), warnings: rows.filter(({ level }) => isWarning(level)).slice(-MAX_ROWS) };
    this.flush();
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

function keyOf({ timeS, node, message }: LogRow): string {
  return `${timeS} ${node} ${message.slice(0, KEY_LENGTH)}`;
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
