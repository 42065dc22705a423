/** The health of plants: readings compared with ideal ranges, as lupin_runtime/twin/health.py does it. */
import { HEALTH, IDEAL_RANGES } from "@/generated/robot";

export type Sensor = keyof typeof IDEAL_RANGES;
export type HealthState = (typeof HEALTH.states)[number]["name"] | "no_data";

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

/** Whether a value in its natural unit is below, within or above its range. */
export function side(value: number, { low, high }: IdealRange): "low" | "ideal" | "high" {
  return value < low ? "low" : value > high ? "high" : "ideal";
}

/** The health by the worst reading. Sensors without a range are passed over. */
export function assess(readings: readonly Reading[]): Health {
  let worst: { sensor: Sensor; score: number } | null = null;
  for (const { name, value } of readings) {
    if (!isSensor(name) || !Number.isFinite(value)) continue;
    const score = deviation(inNaturalUnit(name, value), idealRange(name));
    if (worst === null || score > worst.score) worst = { sensor: name, score };
  }
  if (worst === null) return { state: "no_data", score: 0, sensor: null };
  return { state: stateOf(worst.score), ...worst };
}

function stateOf(score: number): HealthState {
  for (const { below, name } of HEALTH.states) if (below === null || score < below) return name;
  return "critical";
}

const ORDER: Record<HealthState, number> = { critical: 0, stressed: 1, healthy: 2, no_data: 3 };

/** Sorts the worst first and the unknown last. */
export function compareHealth(a: Health, b: Health): number {
  return ORDER[a.state] - ORDER[b.state];
}
