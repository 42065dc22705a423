import { beforeEach, describe, expect, it, vi } from "vitest";
import { DRIVE } from "@/generated/robot";
import { type Blocker, Driver, type Velocity, ZERO, clampVelocity } from "./drive";

const FORWARD: Velocity = { x: 0.2, y: 0, yaw: 0 };

describe("Driver", () => {
  let sent: Velocity[];
  let blocker: Blocker | null;
  let driver: Driver;

  beforeEach(() => {
    vi.useFakeTimers();
    sent = [];
    blocker = null;
    driver = new Driver(
      (velocity) => sent.push(velocity),
      () => blocker,
    );
  });

  it("sends at 20 Hz while a stick is held, then one zero, then nothing", () => {
    driver.hold("left-stick", FORWARD);
    vi.advanceTimersByTime(1000);
    expect(sent.length).toBe(21);
    driver.hold("left-stick", ZERO);
    expect(sent.at(-1)).toEqual(ZERO);
    const count = sent.length;
    vi.advanceTimersByTime(1000);
    expect(sent.length).toBe(count);
  });

  it("sends nothing while it is blocked", () => {
    blocker = "stopped";
    driver.hold("left-stick", FORWARD);
    vi.advanceTimersByTime(1000);
    expect(sent).toEqual([]);
  });

  it("keeps a stick dead that was held through a stop until it was at rest", () => {
    driver.hold("left-stick", FORWARD);
    vi.advanceTimersByTime(100);
    blocker = "stopped";
    vi.advanceTimersByTime(100);
    blocker = null;
    sent.length = 0;
    vi.advanceTimersByTime(100);
    driver.hold("left-stick", { ...FORWARD, x: 0.3 });
    vi.advanceTimersByTime(100);
    expect(sent.every((velocity) => velocity.x === 0)).toBe(true);
    driver.hold("left-stick", ZERO);
    driver.hold("left-stick", FORWARD);
    expect(sent.at(-1)).toEqual(FORWARD);
  });

  it("keeps a stick dead that was pushed first during a stop", () => {
    blocker = "no-control";
    driver.hold("keyboard", FORWARD);
    blocker = null;
    vi.advanceTimersByTime(200);
    expect(sent.every((velocity) => velocity.x === 0)).toBe(true);
  });

  it("keeps a refused source dead until it was at rest", () => {
    driver.refuse("gamepad", FORWARD);
    driver.hold("gamepad", FORWARD);
    vi.advanceTimersByTime(200);
    expect(sent.every((velocity) => velocity.x === 0)).toBe(true);
    driver.refuse("gamepad", ZERO);
    driver.hold("gamepad", FORWARD);
    expect(sent.at(-1)).toEqual(FORWARD);
    driver.refuse("gamepad", FORWARD);
    expect(sent.at(-1)).toEqual(ZERO);
  });

  it("adds the two sticks and stays within the limits", () => {
    driver.hold("left-stick", { x: 9, y: -4.5, yaw: 0 });
    driver.hold("right-stick", { x: 0, y: 0, yaw: 99 });
    vi.advanceTimersByTime(50);
    expect(sent.at(-1)).toEqual({ x: DRIVE.maxLinearMps, y: -DRIVE.maxLinearMps / 2, yaw: DRIVE.maxAngularRps });
  });

  it("applies a lowered limit to a stick that is held", () => {
    let limit = 1;
    const limited = new Driver((velocity) => sent.push(velocity), () => null, undefined, () => limit);
    limited.hold("left-stick", { x: 9, y: 0, yaw: 0 });
    limited.hold("right-stick", { x: 0, y: 0, yaw: 99 });
    expect(sent.at(-1)?.x).toBe(DRIVE.maxLinearMps);
    limit = 0.25;
    vi.advanceTimersByTime(50);
    expect(sent.at(-1)).toEqual({ x: DRIVE.maxLinearMps / 4, y: 0, yaw: DRIVE.maxAngularRps / 4 });
    limit = NaN;
    vi.advanceTimersByTime(50);
    expect(sent.at(-1)).toEqual(ZERO);
  });

  it("treats what is not finite as rest", () => {
    expect(clampVelocity({ x: NaN, y: 0, yaw: 0 })).toEqual(ZERO);
    expect(clampVelocity({ x: Infinity, y: 0, yaw: 0 })).toEqual(ZERO);
  });
});
