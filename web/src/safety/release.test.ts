// @vitest-environment jsdom
import { beforeEach, describe, expect, it, vi } from "vitest";
import { releaseStop } from "./release";
import { STATE_MS, StopGate } from "./stop_gate";

describe("the release", () => {
  let stated: boolean[];
  let asked: string[];
  let gate: StopGate;
  const restate = vi.fn<() => void>();

  beforeEach(() => {
    vi.useFakeTimers();
    restate.mockClear();
    stated = [];
    asked = [];
    gate = new StopGate({ stateStop: (engaged) => stated.push(engaged), zero: () => {}, cancelGoals: () => {}, missionDrives: () => false, changed: () => {} }, () => 0);
    gate.start();
    gate.setConnected(true);
    gate.setControl("own");
    gate.engage("user");
    stated = [];
  });

  /** Presses the stop while the request to `path` is on its way. */
  const pressDuring = (path: string) => (requested: string) => {
    asked.push(requested);
    if (requested === path) gate.engage("user");
    return Promise.resolve();
  };

  it("opens the gate, and states no stop from the first request on", async () => {
    const ask = (path: string) => {
      asked.push(path);
      if (path === "/_api/stop") vi.advanceTimersByTime(2 * STATE_MS);
      return Promise.resolve();
    };
    await releaseStop(gate, ask, restate);
    expect(asked).toEqual(["/_api/lease", "/_api/stop"]);
    expect([gate.engaged, stated]).toEqual([false, [false, false, false]]);
  });

  it("is overruled by a stop while control is taken", async () => {
    await expect(releaseStop(gate, pressDuring("/_api/lease"), restate)).rejects.toThrow("release_overruled");
    expect(asked).toEqual(["/_api/lease"]);
    expect([gate.engaged, gate.isStated, stated]).toEqual([true, true, [true]]);
  });

  it("is overruled by a stop while the server releases", async () => {
    await expect(releaseStop(gate, pressDuring("/_api/stop"), restate)).rejects.toThrow("release_overruled");
    expect([gate.engaged, gate.isStated, stated]).toEqual([true, true, [false, true]]);
    expect(restate).toHaveBeenCalledOnce();
  });

  it("states a newer stop again, even if the answer to the release is lost", async () => {
    const ask = (path: string) => {
      if (path !== "/_api/stop") return Promise.resolve();
      gate.engage("user");
      return Promise.reject(new Error("the answer was lost"));
    };
    await expect(releaseStop(gate, ask, restate)).rejects.toThrow("lost");
    expect(restate).toHaveBeenCalledOnce();
    expect([gate.engaged, gate.isStated]).toEqual([true, true]);
  });

  it("leaves the gate closed where the server refuses", async () => {
    await expect(releaseStop(gate, () => Promise.reject(new Error("phone-2 has control")), restate)).rejects.toThrow("phone-2");
    expect([gate.engaged, gate.isStated, stated]).toEqual([true, true, []]);
  });
});
