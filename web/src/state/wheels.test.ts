import { describe, expect, it } from "vitest";
import { ODOMETRY_STALE_MS, type WheelsReading, nextReading, wheelsAt } from "./wheels";

/** The state of the wheels after samples of [time in ms, m/s, rad/s], at a time. */
function after(samples: readonly (readonly [number, number, number])[], nowMs: number) {
  let reading: WheelsReading | null = null;
  for (const [atMs, x, yaw] of samples) {
    reading = nextReading(reading, { linear: { x, y: 0, z: 0 }, angular: { x: 0, y: 0, z: yaw } }, atMs);
  }
  return wheelsAt(reading, nowMs);
}

const REST = Array.from({ length: 5 }, (_, index) => [index * 100, 0, 0] as const);

describe("the wheels", () => {
  it("are unknown without odometry, and until it was at rest for a while", () => {
    expect(after([], 0)).toBe("unknown");
    expect(after(REST.slice(0, 3), 200)).toBe("unknown");
    expect(after(REST, 400)).toBe("standing");
  });

  it("turn at once, and stand only after a while", () => {
    expect(after([...REST, [500, 0.03, 0]], 500)).toBe("turning");
    expect(after([...REST, [500, 0, -0.06]], 500)).toBe("turning");
    expect(after([[0, 0.3, 0], [100, 0, 0], [350, 0, 0]], 350)).toBe("turning");
    expect(after([[0, 0.3, 0], [100, 0, 0], [350, 0, 0], [400, 0, 0]], 400)).toBe("standing");
  });

  it("do not stand for a moment at a change of direction", () => {
    expect(after([[0, 0.3, 0], [100, 0, 0], [300, -0.3, 0], [400, 0, 0], [600, 0, 0]], 600)).toBe("turning");
  });

  it("do not turn by noise", () => {
    expect(after(REST.map(([atMs]) => [atMs, 0.015, 0.04] as const), 400)).toBe("standing");
  });

  it("are unknown once odometry is out of date, and begin anew after a gap", () => {
    expect(after(REST, 401 + ODOMETRY_STALE_MS)).toBe("unknown");
    expect(after([...REST, [5000, 0, 0]], 5000)).toBe("unknown");
    expect(after([[0, 0.3, 0], [5000, 0, 0]], 5000)).toBe("unknown");
  });

  it("are unknown while odometry has no numbers", () => {
    expect(after([...REST, ...Array.from({ length: 20 }, (_, index) => [500 + index * 100, NaN, NaN] as const)], 2400)).toBe("unknown");
  });
});
