import { describe, expect, it } from "vitest";
import { UNKNOWN, clock, fixed, writeMoment, signed, formatDuration, timeOfDay, writeNumbersIn } from "./numbers";

describe("numbers", () => {
  it("have fixed places, a real minus, and no negative zero", () => {
    expect(fixed(-1.239, 2)).toBe("−1.24");
    expect(fixed(-0.001, 2)).toBe("0.00");
    expect(signed(0.5, 1)).toBe("+0.5");
    expect(signed(-0.5, 1)).toBe("−0.5");
  });

  it("that are not known are a dash", () => {
    for (const value of [NaN, Infinity, null, undefined]) expect(fixed(value, 1)).toBe(UNKNOWN);
    expect(formatDuration(-1)).toBe(UNKNOWN);
    expect(signed(NaN, 1)).toBe(UNKNOWN);
  });

  it("of time grow from seconds to hours", () => {
    expect([0.42, 12.9, 185, 3729].map(formatDuration)).toEqual(["0.4 s", "12 s", "03:05", "1:02:09"]);
    expect(clock(59)).toBe("00:59");
    expect(clock(NaN)).toBe(UNKNOWN);
  });

  it("have a decimal comma in Dutch, and every language counts 24 hours", () => {
    const evening = new Date(2026, 10, 27, 21, 5, 9);
    expect(timeOfDay(evening)).toBe("21:05:09");
    writeNumbersIn("nl");
    expect([fixed(-1.239, 2), signed(0.5, 1), formatDuration(0.42), clock(185)]).toEqual(["−1,24", "+0,5", "0,4 s", "03:05"]);
    expect([timeOfDay(evening), writeMoment(evening.getTime() / 1000), writeMoment(185)]).toEqual(["21:05:09", "21:05:09", "03:05"]);
    writeNumbersIn("en");
  });
});
