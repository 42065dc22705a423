import { describe, expect, it } from "vitest";
import { scoreOf } from "./search";

describe("the palette's search", () => {
  it("finds words by their beginnings, in any order", () => {
    expect(scoreOf("Pause the mission", "pau")).toBe(1);
    expect(scoreOf("Pause the mission", "mission pause")).toBeGreaterThan(0);
    expect(scoreOf("Pause the mission", "Mission")).toBe(0.5);
    expect(scoreOf("Noodstop: één keer", "een")).toBe(0.5);
    expect(scoreOf("Anything", "  ")).toBe(1);
  });

  it("finds nothing by letters that are only scattered over a label", () => {
    expect(scoreOf("Open the page of settings", "pause")).toBe(0);
    expect(scoreOf("Pause the mission", "pause it")).toBe(0);
  });
});
