// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { SETTINGS } from "@/generated/settings";
import { TEXT_KEYS } from "@/i18n/text";
import { rowOf } from "@/state/settings";
import { GROUPS, readNumber } from "./groups";

describe("the settings drawer", () => {
  it("shows every setting once, with a name", () => {
    const shown = GROUPS.flatMap(({ names }) => names);
    expect(shown.toSorted()).toEqual(Object.keys(SETTINGS).toSorted());
    for (const name of shown) expect(TEXT_KEYS).toContain(`setting_${name}`);
  });

  it("takes numbers of the range only", () => {
    const speed = rowOf("speedScale");
    expect(readNumber("0.5", speed)).toBe(0.5);
    expect(readNumber("0,5", speed)).toBe(0.5);
    for (const text of ["", "fast", "0", "1.2", "NaN", "Infinity"]) expect(readNumber(text, speed)).toBeNull();
    const hold = rowOf("voiceVadEndHoldMs");
    expect(readNumber(" 800 ", hold)).toBe(800);
    expect(readNumber("800.5", hold)).toBeNull();
  });
});
