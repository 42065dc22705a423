import { describe, expect, it } from "vitest";
import { assess, compareHealth, deviation, idealRange, inNaturalUnit, side } from "./health";

const TEMPERATURE = { low: 18, high: 26, unit: "°C" };

describe("health", () => {
  it("measures deviations in widths of the range", () => {
    expect(deviation(20, TEMPERATURE)).toBe(0);
    expect(deviation(14, TEMPERATURE)).toBe(0.5);
    expect(deviation(1000, TEMPERATURE)).toBe(2);
    expect(deviation(NaN, TEMPERATURE)).toBe(0);
    expect(side(14, TEMPERATURE)).toBe("low");
    expect(side(26, TEMPERATURE)).toBe("ideal");
    expect(side(26.1, TEMPERATURE)).toBe("high");
  });

  it("takes small soil moistures as fractions", () => {
    expect(inNaturalUnit("soil_moisture", 0.4)).toBe(40);
    expect(inNaturalUnit("soil_moisture", 40)).toBe(40);
    expect(inNaturalUnit("humidity", 0.4)).toBe(0.4);
  });

  it("is decided by the worst reading", () => {
    const health = assess([{ name: "temperature", value: 14 }, { name: "light", value: 500 }]);
    expect(health).toEqual({ state: "stressed", score: 0.5, sensor: "temperature" });
    expect(assess([{ name: "temperature", value: 15.7 }]).state).toBe("healthy");
    expect(assess([{ name: "co2", value: 5000 }]).state).toBe("critical");
  });

  it("is unknown without a reading that has a range", () => {
    expect(assess([]).state).toBe("no_data");
    expect(assess([{ name: "temperature", value: NaN }, { name: "wind", value: 3 }]).state).toBe("no_data");
    expect(assess([{ name: "toString", value: 3 }]).state).toBe("no_data");
  });

  it("sorts the worst first", () => {
    const states = [[], [{ name: "light", value: 500 }], [{ name: "light", value: 9000 }]].map(assess);
    expect(states.sort(compareHealth).map((health) => health.state)).toEqual(["critical", "healthy", "no_data"]);
    expect(idealRange("light").unit).toBe("lux");
  });
});
