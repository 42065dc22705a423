/** Damages samples as a faulty node would, for tests. */

/** A message with every number NaN. */
export function withoutNumbers(value: unknown): unknown {
  if (typeof value === "number") return NaN;
  if (Array.isArray(value)) return value.map(withoutNumbers);
  if (value instanceof Float32Array || value instanceof Float64Array) return value.map(() => NaN);
  return mapObject(value, withoutNumbers);
}

/** A message as its type initializes it: no elements, no text, zeros. */
export function emptied(value: unknown): unknown {
  if (typeof value === "number") return 0;
  if (typeof value === "string") return "";
  if (typeof value === "boolean") return false;
  if (Array.isArray(value)) return [];
  if (ArrayBuffer.isView(value)) return new (value.constructor as new (length: number) => unknown)(0);
  return mapObject(value, emptied);
}

function mapObject(value: unknown, change: (value: unknown) => unknown): unknown {
  if (typeof value !== "object" || value === null || ArrayBuffer.isView(value)) return value;
  return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, change(each)]));
}
