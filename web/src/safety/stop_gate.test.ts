import { beforeEach, describe, expect, it, vi } from "vitest";
import { DISCONNECT_GRACE_MS, StopGate, type StopReason } from "./stop_gate";

describe("StopGate", () => {
  let gate: StopGate;
  let stated: boolean[];
  let zeros: number;
  let cancels: number;

  beforeEach(() => {
    vi.useFakeTimers();
    stated = [];
    zeros = 0;
    cancels = 0;
    gate = new StopGate(
      {
        stateStop: (engaged) => stated.push(engaged),
        zero: () => (zeros += 1),
        cancelGoals: () => (cancels += 1),
        changed: () => {},
      },
      () => 0,
    );
    gate.start();
  });

  function inControl(): void {
    gate.setConnected(true);
    gate.setControl(true);
  }

  it("starts engaged, for the reason startup", () => {
    expect([gate.engaged, gate.reason]).toEqual([true, "startup"]);
  });

  it("does not stop the robot by being opened, hidden or closed without control", () => {
    gate.setConnected(true);
    for (const reason of ["window-blur", "visibility-hidden", "before-unload", "rosbridge-disconnect"] as StopReason[]) {
      gate.release();
      gate.engage(reason);
      expect(gate.engaged).toBe(true);
    }
    vi.advanceTimersByTime(2000);
    expect([stated, zeros, cancels]).toEqual([[], 0, 0]);
  });

  it("stops the robot for a person without control, and keeps stating it", () => {
    gate.setConnected(true);
    gate.engage("user");
    vi.advanceTimersByTime(1000);
    expect(stated).toEqual([true, true, true]);
    expect([zeros, cancels]).toEqual([0, 1]);
  });

  it("sends zero twenty times a second while it is engaged in control", () => {
    inControl();
    vi.advanceTimersByTime(1000);
    expect(zeros).toBe(20);
    gate.release();
    vi.advanceTimersByTime(1000);
    expect(zeros).toBe(20);
  });

  it("is released by hand only", () => {
    inControl();
    gate.release();
    gate.engage("window-blur");
    gate.setConnected(false);
    gate.setConnected(true);
    vi.advanceTimersByTime(60_000);
    expect([gate.engaged, gate.reason]).toEqual([true, "window-blur"]);
    gate.release();
    expect(gate.engaged).toBe(false);
  });

  it("engages once an outage has lasted five seconds, however often the page tries to reconnect", () => {
    gate.setConnected(true);
    gate.release();
    gate.setConnected(false);
    vi.advanceTimersByTime(DISCONNECT_GRACE_MS - 1);
    gate.setConnected(false);
    expect(gate.engaged).toBe(false);
    vi.advanceTimersByTime(1);
    expect(gate.reason).toBe("rosbridge-disconnect");
  });

  it("does not engage for a short outage, nor before the first connection", () => {
    gate.release();
    gate.setConnected(false);
    vi.advanceTimersByTime(60_000);
    gate.setConnected(true);
    gate.setConnected(false);
    vi.advanceTimersByTime(1000);
    gate.setConnected(true);
    vi.advanceTimersByTime(60_000);
    expect(gate.engaged).toBe(false);
  });

  it("states the stop again after a reconnect", () => {
    inControl();
    gate.engage("user");
    gate.setConnected(false);
    stated.length = 0;
    gate.setConnected(true);
    expect(stated).toEqual([true]);
  });

  it("closes when control is lost", () => {
    inControl();
    gate.release();
    gate.setControl(false);
    expect(gate.engaged).toBe(true);
  });

  it("keeps the first reason, but a person's stop replaces a page's own", () => {
    inControl();
    gate.release();
    gate.engage("window-blur");
    gate.engage("visibility-hidden");
    expect(gate.reason).toBe("window-blur");
    const watching = new StopGate({ stateStop: () => {}, zero: () => {}, cancelGoals: () => {}, changed: () => {} });
    watching.engage("user");
    expect(watching.reason).toBe("user");
  });
});
