import { describe, expect, it } from "vitest";
import { INSTRUMENTS, type Instrument, isLive, milestones } from "./milestones";

const at = (...heard: Instrument[]) => new Map(heard.map((instrument, index) => [instrument, 100 * (index + 1)]));
const reached = (linkMs: number | null, roundTripMs: number | null, heard: Map<Instrument, number>) =>
  milestones({ linkMs, roundTripMs, heard })
    .filter((each) => each.reached)
    .map(({ name, atMs }) => `${name} ${atMs}`);

describe("the milestones of a start", () => {
  it("advance in their order, at the time of what was seen", () => {
    expect(reached(null, null, at())).toEqual([]);
    expect(reached(40, null, at("odometry", "battery"))).toEqual(["link 40"]);
    expect(reached(40, 12, at("odometry"))).toEqual(["link 40", "handshake 52"]);
    expect(reached(40, 12, at("odometry", "battery"))).toEqual(["link 40", "handshake 52", "telemetry 200"]);
    expect(reached(40, 12, at(...INSTRUMENTS))).toEqual(["link 40", "handshake 52", "telemetry 300", "live 500"]);
    expect(reached(null, 12, at(...INSTRUMENTS))).toEqual([]);
  });

  it("say what is missing", () => {
    const steps = milestones({ linkMs: 40, roundTripMs: 11.6, heard: at("odometry", "battery", "joints") });
    expect(steps[1]?.values).toEqual({ ms: 12 });
    expect(steps[3]).toMatchObject({ detail: "boot_live_missing", instruments: ["lidar", "estop"] });
    expect(isLive(steps)).toBe(false);
  });
});
