/** Numbers as the page writes them: fixed places, a real minus sign, a dash for what is not known. */

export const UNKNOWN = "–";

export function fixed(value: number | null | undefined, places: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const text = value.toFixed(places);
  // "-0.00" is zero.
  return Number(text) === 0 ? (0).toFixed(places) : text.replace("-", "\u2212");
}

/** As `fixed`, with a plus sign before positive numbers. */
export function signed(value: number | null | undefined, places: number): string {
  const text = fixed(value, places);
  return text === UNKNOWN || text.startsWith("\u2212") ? text : `+${text}`;
}

/** A span of time: 0.4 s, 12 s, 03:05, 1:02:09. */
export function span(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds) || seconds < 0) return UNKNOWN;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 60) return `${Math.floor(seconds)} s`;
  return clock(seconds);
}

/** Minutes and seconds, with hours where there are any. */
export function clock(seconds: number): string {
  if (!Number.isFinite(seconds)) return UNKNOWN;
  const whole = Math.floor(seconds);
  const two = (value: number) => String(value).padStart(2, "0");
  const minutes = `${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
  return whole < 3600 ? minutes : `${Math.floor(whole / 3600)}:${minutes}`;
}

export function toDegrees(angleRad: number): number {
  return (angleRad * 180) / Math.PI;
}

export function toRadians(angleDeg: number): number {
  return (angleDeg * Math.PI) / 180;
}
