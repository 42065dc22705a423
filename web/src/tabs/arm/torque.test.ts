import { describe, expect, it } from "vitest";
import { nextTorque } from "./torque";

describe("the torque", () => {
  it("arms the sliders only once the robot confirmed the switch", () => {
    expect(nextTorque(null, { kind: "reported", on: true })).toBeNull();
    expect(nextTorque(null, { kind: "confirmed", on: true })).toBe(true);
    expect(nextTorque(true, { kind: "reported", on: true })).toBe(true);
  });

  it("is off when the robot says so, and unknown when it returned without us", () => {
    expect(nextTorque(true, { kind: "reported", on: false })).toBe(false);
    expect(nextTorque(false, { kind: "reported", on: true })).toBeNull();
    expect(nextTorque(true, { kind: "confirmed", on: false })).toBe(false);
  });

  it("is unknown after a lost link and a failed switch", () => {
    expect(nextTorque(true, { kind: "link-lost" })).toBeNull();
    expect(nextTorque(true, { kind: "failed" })).toBeNull();
  });
});
