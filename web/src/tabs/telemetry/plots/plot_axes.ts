/** The axes of a plot: ranges, marks and their texts. */
import { withDecimalMark } from "@/ui/numbers";

/** A difference below this fraction of the value is noise, and is not magnified. */
const LEAST_SPAN_SHARE = 0.02;
const LEAST_SPAN = 0.1;

/** The smallest and largest value with a margin; a constant line is drawn in the middle. */
export function rangeOf(min: number | null, max: number | null): [number, number] {
  if (min === null || max === null || !Number.isFinite(min) || !Number.isFinite(max)) return [-1, 1];
  const least = Math.max(LEAST_SPAN_SHARE * Math.max(Math.abs(min), Math.abs(max)), max > min ? 0 : LEAST_SPAN);
  const air = Math.max((max - min) * 0.08, (least - (max - min)) / 2);
  return [min - air, max + air];
}

const STEPS_S = [5, 10, 15, 30, 60, 120] as const;
const LABEL_PX = 72;

/** Round times before the newest one, as many as there is room for on an axis of a width. */
export function timeSplits(min: number, max: number, width: number): number[] {
  const room = Math.max(1, width / LABEL_PX);
  const step = STEPS_S.find((each) => (max - min) / each <= room) ?? 120;
  const splits: number[] = [];
  for (let time = max; time >= min - 1e-6; time -= step) splits.unshift(time);
  return splits;
}

export function timeLabel(seconds: number): string {
  const whole = Math.round(seconds);
  if (whole === 0) return "0 s";
  return whole % 60 === 0 ? `\u2212${-whole / 60} min` : `\u2212${-whole} s`;
}

export function axisNumber(value: number): string {
  const size = Math.abs(value);
  const text = size !== 0 && (size >= 1e5 || size < 1e-3) ? value.toExponential(1) : String(Number(value.toPrecision(5)));
  return withDecimalMark(text.replace("-", "\u2212"));
}
