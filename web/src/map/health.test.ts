import { describe, expect, it } from "vitest";
import { assess, compareHealth, deviation, idealRange, inNaturalUnit, judge, SENSORS } from "./health";

const TEMPERATURE = { low: 18, high: 26, unit: "°C" };

describe("health", () => {
  it("measures deviations in widths of the range", () => {
    expect(deviation(20, TEMPERATURE)).toBe(0);
    expect(deviation(14, TEMPERATURE)).toBe(0.5);
    expect(deviation(1000, TEMPERATURE)).toBe(2);
    expect(deviation(NaN, TEMPERATURE)).toBe(0);
  });

  it("tells where a value lies", () => {
    expect(judge("temperature", 14).side).toBe("low");
    expect(judge("temperature", 26).side).toBe("ideal");
    expect(judge("temperature", 26.1).side).toBe("high");
    expect(judge("temperature", NaN)).toEqual({ side: "ideal", state: "no_data", score: 0 });
  });

  it("calls healthy exactly what lies within its range", () => {
    for (const sensor of SENSORS) {
      const { low, high } = idealRange(sensor);
      for (let step = -300; step <= 400; step += 1) {
        const value = low + ((high - low) * step) / 100;
        const { side, state } = judge(sensor, value);
        expect(state === "healthy", `${sensor} ${value}`).toBe(side === "ideal");
        // The health of a plant with this reading says the same.
        if (value > 1) expect(assess([{ name: sensor, value }]).state).toBe(state);
      }
    }
  });

  it("takes small soil moistures as fractions", () => {
    expect(inNaturalUnit("soil_moisture", 0.4)).toBe(40);
    expect(inNaturalUnit("soil_moisture", 40)).toBe(40);
    expect(inNaturalUnit("humidity", 0.4)).toBe(0.4);
  });

  it("is decided by the worst reading", () => {
    const health = assess([{ name: "temperature", value: 14 }, { name: "light", value: 500 }]);
    expect(health).toEqual({ state: "stressed", score: 0.5, sensor: "temperature" });
    expect(assess([{ name: "temperature", value: 15.7 }]).state).toBe("off_range");
    expect(assess([{ name: "co2", value: 5000 }]).state).toBe("critical");
  });

  it("is unknown without a reading that has a range", () => {
    expect(assess([]).state).toBe("no_data");
    expect(assess([{ name: "temperature", value: NaN }, { name: "wind", value: 3 }]).state).toBe("no_data");
    expect(assess([{ name: "toString", value: 3 }]).state).toBe("no_data");
  });

  it("sorts the worst first", () => {
    const states = [[], [{ name: "light", value: 500 }], [{ name: "light", value: 810 }], [{ name: "light", value: 9000 }]].map(assess);
    expect(states.sort(compareHealth).map((health) => health.state)).toEqual(["critical", "off_range", "healthy", "no_data"]);
    expect(idealRange("light").unit).toBe("lux");
  });
});
