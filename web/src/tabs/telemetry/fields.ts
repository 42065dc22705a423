/**
 * The numeric fields of messages: their paths, such as `twist.twist.linear.x` or `ranges[12]`, and their values. Where a message
 * has names beside its numbers, as joint states do, an element is called by its name: `position[elbow_joint]`.
 */

/** Number of elements that are listed of a long array; others can be typed. */
const LISTED_ELEMENTS = 32;
const DEEPEST = 8;

export interface Field {
  path: string;
  value: number;
}

/** The number at a path; NaN if there is none. Booleans count as 0 and 1. */
export function valueAt(message: unknown, path: string): number {
  let parent: unknown = null;
  let value: unknown = message;
  for (const step of stepsOf(path)) {
    if (typeof value !== "object" || value === null) return NaN;
    const isNamed = isList(value) && !/^\d+$/.test(step);
    const key = isNamed ? (namesIn(parent)?.indexOf(step) ?? -1) : step;
    parent = value;
    value = (value as Record<string | number, unknown>)[key];
  }
  return toNumber(value);
}

/** The numeric fields of a message, up to `limit`. */
export function numericFields(message: unknown, limit = 200): Field[] {
  const found: Field[] = [];
  collect(message, null, "", 0, found, limit);
  return found;
}

function collect(value: unknown, parent: unknown, path: string, depth: number, found: Field[], limit: number): void {
  if (found.length >= limit || depth > DEEPEST) return;
  if (isNumeric(value)) {
    if (path !== "") found.push({ path, value: toNumber(value) });
    return;
  }
  if (isList(value)) {
    const length = Math.min(value.length, LISTED_ELEMENTS);
    const names = namesIn(parent);
    const isNamed = names !== null && names.length === value.length && new Set(names).size === names.length;
    for (let index = 0; index < length; index += 1) collect(value[index], value, `${path}[${isNamed ? names[index] : index}]`, depth + 1, found, limit);
    return;
  }
  if (typeof value !== "object" || value === null) return;
  for (const [name, child] of Object.entries(value)) collect(child, value, path === "" ? name : `${path}.${name}`, depth + 1, found, limit);
}

function stepsOf(path: string): string[] {
  return [...path.matchAll(/\[([^\]]+)\]|([^.[\]]+)/g)].map((match) => match[1] ?? match[2] ?? "");
}

function namesIn(parent: unknown): string[] | null {
  const names = typeof parent === "object" && parent !== null ? (parent as { name?: unknown }).name : null;
  return Array.isArray(names) && names.every((name) => typeof name === "string") ? names : null;
}

function isNumeric(value: unknown): boolean {
  return typeof value === "number" || typeof value === "boolean" || typeof value === "bigint";
}

function toNumber(value: unknown): number {
  return isNumeric(value) ? Number(value) : NaN;
}

function isList(value: unknown): value is ArrayLike<unknown> {
  return Array.isArray(value) || (ArrayBuffer.isView(value) && !(value instanceof DataView));
}
