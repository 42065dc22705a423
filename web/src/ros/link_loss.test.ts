import { describe, expect, it } from "vitest";
import { lostSince } from "./link_loss";
import type { LinkState } from "./rosbridge";

/** When the link counts as lost after each change of its state, one per second. */
function losses(states: readonly LinkState[]): (number | null)[] {
  let before: { lostMs: number | null; wasOpen: boolean } = { lostMs: null, wasOpen: false };
  return states.map((state, index) => {
    before = { lostMs: lostSince(before, state, index * 1000), wasOpen: before.wasOpen || state === "open" };
    return before.lostMs;
  });
}

describe("the loss of the link", () => {
  it("is none before the link was open", () => {
    expect(losses(["connecting", "lost", "connecting", "open"])).toEqual([null, null, null, null]);
  });

  it("begins once, whatever the attempts to connect do", () => {
    expect(losses(["open", "lost", "connecting", "lost", "connecting", "open", "lost"])).toEqual([null, 1000, 1000, 1000, 1000, 1000, 1000]);
  });
});
