/** The run's processes and topic rates as rows of tables. */
import type { ProcessState, RunState } from "@/api/console_store";
import { TOPICS } from "@/generated/graph";

export type ProcessHealth = "up" | "trouble" | "starting" | "waiting" | "failed" | "stopped";

export interface ProcessRow extends ProcessState {
  health: ProcessHealth;
  /** What is wrong, or what it waits for; empty while it works. */
  remark: string;
}

const ORDER: readonly ProcessHealth[] = ["failed", "trouble", "starting", "waiting", "up", "stopped"];
/** A topic is slow below this fraction of its expected rate. */
const SLOW_SHARE = 0.7;

/** The processes, those that need the operator's attention first. */
export function processRows(run: RunState): ProcessRow[] {
  return (run.stages ?? [])
    .map((stage) => ({ ...stage, health: healthOf(stage), remark: stage.trouble || stage.why || (stage.waiting_for ?? []).join("; ") }))
    .toSorted((a, b) => ORDER.indexOf(a.health) - ORDER.indexOf(b.health));
}

function healthOf({ phase, trouble }: ProcessState): ProcessHealth {
  if (phase === "failed" || phase === "starting" || phase === "waiting" || phase === "stopped") return phase;
  return trouble === "" ? "up" : "trouble";
}

export interface RateRow {
  topic: string;
  hz: number;
  /** The topic's nominal rate in the graph's table; null if it has none. */
  expectedHz: number | null;
  /** Seconds since the topic fell silent; null while messages arrive. */
  silentS: number | null;
  isSlow: boolean;
}

const EXPECTED_HZ = new Map<string, number | null>(Object.values(TOPICS).map(({ name, rateHz }) => [name, rateHz]));

/** The monitored topics, silent and slow ones first. */
export function rateRows(run: RunState): RateRow[] {
  const names = new Set([...Object.keys(run.rates_hz ?? {}), ...Object.keys(run.silent_s ?? {})]);
  return [...names]
    .map((topic) => {
      const hz = run.rates_hz?.[topic] ?? 0;
      const expectedHz = EXPECTED_HZ.get(topic) ?? null;
      const silentS = run.silent_s?.[topic] ?? null;
      return { topic, hz, expectedHz, silentS, isSlow: expectedHz !== null && hz > 0 && hz < SLOW_SHARE * expectedHz };
    })
    .toSorted((a, b) => rank(a) - rank(b) || a.topic.localeCompare(b.topic));
}

function rank({ silentS, isSlow }: RateRow): number {
  return silentS !== null ? 0 : isSlow ? 1 : 2;
}
