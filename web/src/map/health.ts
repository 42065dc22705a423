/** The health of plants: readings compared with ideal ranges, as lupin_runtime/twin/health.py does it. */
import { HEALTH, IDEAL_RANGES } from "@/generated/robot";

export type Sensor = keyof typeof IDEAL_RANGES;
/** `off_range` is a part of the runtime's `healthy`: a little outside of the range, which must not look like within it. */
export type HealthState = (typeof HEALTH.states)[number]["name"] | typeof HEALTH.offRange | "no_data";

export const SENSORS = Object.keys(IDEAL_RANGES) as Sensor[];

export interface IdealRange {
  low: number;
  high: number;
  unit: string;
}

export interface Reading {
  name: string;
  value: number;
}

export interface Health {
  state: HealthState;
  /** The largest deviation. */
  score: number;
  /** The sensor that decides the state; null without a known reading. */
  sensor: Sensor | null;
}

export function isSensor(name: string): name is Sensor {
  return Object.hasOwn(IDEAL_RANGES, name);
}

export function idealRange(sensor: Sensor): IdealRange {
  return IDEAL_RANGES[sensor];
}

/** Soil moisture comes as a fraction from the greenhouse package and in percent from others; no planted soil has 1 %. */
export function inNaturalUnit(sensor: string, value: number): number {
  return sensor === "soil_moisture" && value >= 0 && value <= 1 ? value * 100 : value;
}

/** The distance to the nearer bound in widths of the range; 0 within it and for NaN. */
export function deviation(value: number, { low, high }: IdealRange): number {
  if (!Number.isFinite(value)) return 0;
  return Math.min(HEALTH.maxDeviation, Math.max(low - value, value - high, 0) / (high - low));
}

export interface Judgement {
  /** Where the value lies: what an arrow shows. */
  side: "low" | "ideal" | "high";
  /** What marks and colors show: `healthy` only within the range. */
  state: HealthState;
  score: number;
}

/** The one judgement of a value in its natural unit: arrows, marks, colors and the health of a plant derive from it. */
export function judge(sensor: Sensor, value: number): Judgement {
  if (!Number.isFinite(value)) return { side: "ideal", state: "no_data", score: 0 };
  const range = idealRange(sensor);
  const score = deviation(value, range);
  return { side: value < range.low ? "low" : value > range.high ? "high" : "ideal", state: stateOf(score), score };
}

/** The health by the worst reading. Sensors without a range are passed over. */
export function assess(readings: readonly Reading[]): Health {
  let worst: Health = { state: "no_data", score: 0, sensor: null };
  for (const { name, value } of readings) {
    if (!isSensor(name) || !Number.isFinite(value)) continue;
    const { state, score } = judge(name, inNaturalUnit(name, value));
    if (worst.sensor === null || score > worst.score) worst = { state, score, sensor: name };
  }
  return worst;
}

function stateOf(score: number): HealthState {
  const state = HEALTH.states.find(({ below }) => below === null || score < below)?.name ?? "critical";
  return state === "healthy" && score > 0 ? HEALTH.offRange : state;
}

const ORDER: Record<HealthState, number> = { critical: 0, stressed: 1, off_range: 2, healthy: 3, no_data: 4 };

/** Sorts the worst first and the unknown last. */
export function compareHealth(a: Health, b: Health): number {
  return ORDER[a.state] - ORDER[b.state];
}
