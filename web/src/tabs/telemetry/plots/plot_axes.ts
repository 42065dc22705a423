/** The axes of a plot: ranges, marks and their texts. */

/** The smallest and largest value with some air; a line that stands still is drawn in the middle. */
export function rangeOf(min: number | null, max: number | null): [number, number] {
  if (min === null || max === null || !Number.isFinite(min) || !Number.isFinite(max)) return [-1, 1];
  const air = max > min ? (max - min) * 0.08 : Math.max(0.05, Math.abs(max) * 0.02);
  return [min - air, max + air];
}

/** Round times before the newest one. */
export function timeSplits(min: number, max: number): number[] {
  const step = max - min > 200 ? 60 : max - min > 40 ? 10 : 5;
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
  return text.replace("-", "\u2212");
}
