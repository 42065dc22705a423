/** Numbers and times as the page writes them: fixed places, a real minus sign, a dash for what is not known; in Dutch, a decimal comma. */

export const UNKNOWN = "–";

let language = "en";

/** Write in another language from now on; called with each change of the page's language. */
export function writeNumbersIn(next: string): void {
  language = next;
}

/** A number, as JavaScript writes it, with the decimal mark of the language. */
export function withDecimalMark(text: string): string {
  return language === "nl" ? text.replace(".", ",") : text;
}

/** The time of the day, such as 14:05:09. */
export function timeOfDay(date: Date): string {
  return date.toLocaleTimeString(language, { hourCycle: "h23" });
}

/** The day and the time. */
export function dayAndTime(date: Date): string {
  return date.toLocaleString(language, { dateStyle: "medium", timeStyle: "short", hourCycle: "h23" });
}

/** A time of the robot's clock; in the simulator, that is the time since its start. */
export function writeMoment(seconds: number): string {
  return seconds > 1e9 ? timeOfDay(new Date(seconds * 1000)) : clock(seconds);
}

export function fixed(value: number | null | undefined, places: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const text = value.toFixed(places);
  // "-0.00" is zero.
  return withDecimalMark(Number(text) === 0 ? (0).toFixed(places) : text.replace("-", "\u2212"));
}

/** As `fixed`, with a plus sign before positive numbers. */
export function signed(value: number | null | undefined, places: number): string {
  const text = fixed(value, places);
  return text === UNKNOWN || text.startsWith("\u2212") ? text : `+${text}`;
}

/** A span of time: 0.4 s, 12 s, 03:05, 1:02:09. */
export function formatDuration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds) || seconds < 0) return UNKNOWN;
  if (seconds < 10) return `${fixed(seconds, 1)} s`;
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
