/** Heat maps of the twin's sensors: their colors, and a field as pixels of the occupancy grid. */
import type { lupin_msgs_GetField_Response } from "@/generated/messages";
import { FLOOR, type Grid, OUTSIDE, fromCells } from "./grid";
import { type Sensor, inNaturalUnit } from "./health";

/** Hue in degrees, lightness in percent from the lowest to the highest value. */
const COLORS: Record<Sensor, { hue: number; light: readonly [number, number] }> = {
  temperature: { hue: 30, light: [80, 40] },
  humidity: { hue: 190, light: [75, 45] },
  co2: { hue: 5, light: [78, 42] },
  light: { hue: 50, light: [80, 50] },
  soil_moisture: { hue: 165, light: [75, 42] },
};
const SATURATION = 0.7;
const HIGHEST_ALPHA = 0.6;
/** With the contract's 0.6 t alone, the lowest value would not be seen at all. */
const LOWEST_ALPHA = 0.3;

export interface Field {
  sensor: Sensor;
  width: number;
  height: number;
  origin: { x: number; y: number };
  resolutionM: number;
  /** Row by row from the origin, NaN where nothing was measured. */
  values: Float32Array;
  /** Of the measured cells, in the sensor's natural unit; null without any. */
  range: { low: number; high: number } | null;
  samples: number;
}

/** The field of an answer, in natural units; null where it is refused or its numbers contradict each other. */
export function readField(sensor: Sensor, answer: lupin_msgs_GetField_Response): Field | null {
  const { width, height, resolution_used: resolutionM } = answer;
  const given = answer.values as ArrayLike<number | null> | null;
  if (!answer.ok || given === null || !(width > 0 && height > 0 && resolutionM > 0) || given.length !== width * height) return null;
  // Answers come as JSON, where NaN is null.
  const values = Float32Array.from({ length: given.length }, (_, index) => inNaturalUnit(sensor, given[index] ?? NaN));
  return {
    sensor,
    width,
    height,
    origin: { x: answer.origin_x, y: answer.origin_y },
    resolutionM,
    values,
    range: rangeOf(values),
    samples: answer.sample_count,
  };
}

function rangeOf(values: Float32Array): { low: number; high: number } | null {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (!Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return low <= high ? { low, high } : null;
}

/** Where a value lies in its range, 0..1; 1 where all values are equal. */
export function share(value: number, { low, high }: { low: number; high: number }): number {
  return high - low < 1e-9 ? 1 : Math.min(1, Math.max(0, (value - low) / (high - low)));
}

/** The color at a share 0..1: red, green, blue 0..255 and alpha 0..1. */
export function heatColor(sensor: Sensor, at: number): [number, number, number, number] {
  const { hue, light } = COLORS[sensor];
  const lightness = (light[0] + (light[1] - light[0]) * at) / 100;
  const chroma = SATURATION * Math.min(lightness, 1 - lightness);
  const channel = (offset: number) => {
    const turn = (offset + hue / 30) % 12;
    return Math.round(255 * (lightness - chroma * Math.max(-1, Math.min(turn - 3, 9 - turn, 1))));
  };
  return [channel(0), channel(8), channel(4), Math.max(LOWEST_ALPHA, HIGHEST_ALPHA * at)];
}

export function heatCss(sensor: Sensor, at: number): string {
  const [red, green, blue, alpha] = heatColor(sensor, at);
  return `rgb(${red} ${green} ${blue} / ${alpha})`;
}

/**
 * The value at a point: between the cells around it that were measured. NaN where its own cell was not, and in the outer corners
 * of measured cells, so that a round field does not look like stairs.
 */
export function valueAt(field: Field, x: number, y: number): number {
  const column = (x - field.origin.x) / field.resolutionM;
  const row = (y - field.origin.y) / field.resolutionM;
  if (!Number.isFinite(cell(field, Math.floor(column), Math.floor(row)))) return NaN;
  const left = Math.floor(column - 0.5);
  const lower = Math.floor(row - 0.5);
  const across = column - 0.5 - left;
  const up = row - 0.5 - lower;
  let [sum, weights] = [0, 0];
  for (const [dx, wx] of [[0, 1 - across], [1, across]] as const) {
    for (const [dy, wy] of [[0, 1 - up], [1, up]] as const) {
      const value = cell(field, left + dx, lower + dy);
      if (!Number.isFinite(value)) continue;
      sum += value * wx * wy;
      weights += wx * wy;
    }
  }
  return weights >= 0.49 ? sum / weights : NaN;
}

function cell(field: Field, column: number, row: number): number {
  if (column < 0 || row < 0 || column >= field.width || row >= field.height) return NaN;
  return field.values[row * field.width + column] ?? NaN;
}

/** The field as pixels of the grid, its last row first, painted on the floor only, and only where it was measured. */
export function paintField(field: Field, grid: Grid, kinds: Uint8Array): Uint8ClampedArray<ArrayBuffer> {
  const { width, height } = grid;
  const pixels = new Uint8ClampedArray(width * height * 4);
  if (field.range === null) return pixels;
  const table = Array.from({ length: 65 }, (_, step) => heatColor(field.sensor, step / 64));
  for (let row = 0; row < height; row += 1) {
    for (let column = 0; column < width; column += 1) {
      const kind = kinds[row * width + column] ?? OUTSIDE;
      if (kind !== FLOOR) continue;
      const point = fromCells(grid, column + 0.5, row + 0.5);
      const value = valueAt(field, point.x, point.y);
      if (Number.isNaN(value)) continue;
      const [red, green, blue, alpha] = table[Math.round(share(value, field.range) * 64)] ?? [0, 0, 0, 0];
      pixels.set([red, green, blue, alpha * 255], ((height - 1 - row) * width + column) * 4);
    }
  }
  return pixels;
}
