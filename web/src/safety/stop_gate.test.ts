import { beforeEach, describe, expect, it, vi } from "vitest";
import { DISCONNECT_GRACE_MS, StopGate, type StopReason } from "./stop_gate";

describe("StopGate", () => {
  let gate: StopGate;
  let stated: boolean[];
  let zeros: number;
  let cancels: number;
  let presses: string[];

  beforeEach(() => {
    vi.useFakeTimers();
    stated = [];
    zeros = 0;
    cancels = 0;
    presses = [];
    gate = new StopGate(
      {
        stateStop: (engaged, press) => {
          stated.push(engaged);
          presses.push(press);
        },
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
    gate.setControl("own");
  }

  it("starts engaged, for the reason startup", () => {
    expect([gate.engaged, gate.reason]).toEqual([true, "startup"]);
  });

  it("forgets its stop without a word that would release it", () => {
    inControl();
    gate.engage("user");
    stated.length = 0;
    gate.setControl("other");
    gate.forget();
    vi.advanceTimersByTime(2000);
    expect([gate.engaged, gate.isStated, stated]).toEqual([true, false, []]);
    gate.setConnected(false);
    gate.setConnected(true);
    expect(stated).toEqual([]);
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

  it("sends zero twenty times a second while its stop is stated in control", () => {
    inControl();
    gate.engage("window-blur");
    vi.advanceTimersByTime(1000);
    expect([zeros, gate.holdsWheels]).toEqual([21, true]);
    gate.release();
    vi.advanceTimersByTime(1000);
    expect(zeros).toBe(21);
  });

  it.each(["startup", "control-lost", "user"] as const)("sends no zero where it is merely closed: %s", (reason) => {
    inControl();
    if (reason !== "startup") gate.release();
    if (reason === "control-lost") {
      gate.setControl("nobody");
      gate.setControl("own");
    }
    if (reason === "user") {
      gate.engage("user");
      gate.withdraw();
    }
    zeros = 0;
    vi.advanceTimersByTime(1000);
    expect([zeros, gate.holdsWheels, gate.engaged, gate.reason]).toEqual([0, false, true, reason]);
  });

  it("gives each press of a person a name, which its repetitions keep, also after a reconnect", () => {
    inControl();
    gate.engage("user");
    vi.advanceTimersByTime(1000);
    gate.setConnected(false);
    gate.setConnected(true);
    const first = gate.press;
    expect(new Set(presses)).toEqual(new Set([first]));
    expect(first).toMatch(/^press:./);
    gate.engage("user");
    expect(gate.press).not.toBe(first);
    expect(presses.at(-1)).toBe(gate.press);
    gate.engage("window-blur");
    expect(presses.at(-1)).toBe(gate.press);
  });

  it("lets go of the press that it stated", () => {
    gate.setConnected(true);
    gate.engage("user");
    const { press } = gate;
    gate.withdraw();
    expect([stated.at(-1), presses.at(-1)]).toEqual([false, press]);
  });

  it("leaves the release to others without opening, and states the stop no more", () => {
    gate.setConnected(true);
    gate.engage("user");
    gate.withdraw();
    vi.advanceTimersByTime(2000);
    expect([stated.at(-1), stated.filter((each) => !each).length]).toEqual([false, 1]);
    expect([gate.engaged, gate.reason, gate.isStated]).toEqual([true, "user", false]);
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
    gate.setControl("other");
    expect(gate.engaged).toBe(true);
  });

  it("keeps the first reason, but a person's stop replaces a page's own", () => {
    inControl();
    gate.release();
    gate.engage("window-blur");
    gate.engage("visibility-hidden");
    expect(gate.reason).toBe("window-blur");
    gate.engage("user");
    expect(gate.reason).toBe("user");
    gate.engage("window-blur");
    expect(gate.reason).toBe("user");
  });

  it("takes the reason of the stop that reaches the robot, not that of its start", () => {
    inControl();
    gate.engage("window-blur");
    expect([gate.reason, stated]).toEqual(["window-blur", [true]]);
  });

  it("closes with a reason of its own when control is lost", () => {
    inControl();
    gate.release();
    gate.setControl("nobody");
    expect([gate.engaged, gate.reason, stated]).toEqual([true, "control-lost", []]);
  });

  describe("after an outage", () => {
    beforeEach(() => {
      inControl();
      gate.release();
      gate.setConnected(false);
      vi.advanceTimersByTime(DISCONNECT_GRACE_MS);
      stated.length = 0;
      zeros = 0;
    });

    it("stops nobody who has control by now", () => {
      gate.setConnected(true, false);
      vi.advanceTimersByTime(1000);
      expect([stated, zeros]).toEqual([[], 0]);
      gate.setControl("other");
      vi.advanceTimersByTime(1000);
      expect([stated, zeros, gate.engaged, gate.reason]).toEqual([[], 0, true, "rosbridge-disconnect"]);
    });

    it.each(["own", "nobody"] as const)("states its stop where control is with: %s", (holder) => {
      gate.setConnected(true, false);
      gate.setControl(holder);
      expect([stated, gate.isStated]).toEqual([[true], true]);
    });

    it("states it at once where the channel of control was not interrupted", () => {
      gate.setConnected(true, true);
      expect(stated).toEqual([true]);
    });

    it("states at once what a person asked for", () => {
      gate.engage("user");
      gate.setConnected(true, false);
      expect(stated).toEqual([true, true]);
    });
  });

  it("states an automatic stop anew only once it knows who has control", () => {
    inControl();
    gate.engage("window-blur");
    gate.setConnected(false);
    stated.length = 0;
    gate.setConnected(true, false);
    gate.setControl("other");
    vi.advanceTimersByTime(1000);
    expect([stated, gate.isStated, gate.engaged]).toEqual([[], false, true]);
  });

  it("counts every closing, so that a release can be overruled", () => {
    inControl();
    gate.release();
    const before = gate.closings;
    gate.engage("user");
    gate.engage("user");
    gate.setControl("other");
    expect(gate.closings).toBe(before + 3);
  });
});
