import { describe, expect, it } from "vitest";
import { RecentKeys } from "./recent_keys";

describe("recent keys", () => {
  it("are new once, as long as they are remembered", () => {
    const keys = new RecentKeys(3);
    expect(["a", "b", "a", "c"].map((key) => keys.add(key))).toEqual([true, true, false, true]);
    // "a" came again after "b", which is the oldest now.
    expect(keys.add("d")).toBe(true);
    expect(keys.add("a")).toBe(false);
    expect(keys.add("b")).toBe(true);
  });

  it("do not grow without bound", () => {
    const keys = new RecentKeys(100);
    for (let number = 0; number < 10_000; number += 1) keys.add(String(number));
    expect(keys.size).toBe(100);
    expect(keys.add("9999")).toBe(false);
  });
});
