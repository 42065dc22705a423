// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { isSame } from "./use_topic_value";

describe("the comparison of selected values", () => {
  it("compares fields, not objects", () => {
    expect(isSame({ a: 1, b: NaN }, { a: 1, b: NaN })).toBe(true);
    expect(isSame({ a: 1 }, { a: 1, b: undefined })).toBe(false);
    expect(isSame({ a: 1 }, { a: 2 })).toBe(false);
    expect(isSame(null, {})).toBe(false);
    expect(isSame("a", "a")).toBe(true);
  });
});
