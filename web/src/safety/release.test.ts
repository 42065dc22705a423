// @vitest-environment jsdom
import { beforeEach, describe, expect, it, vi } from "vitest";
import type { StopHold } from "@/api/console_store";
import { releaseStop } from "./release";
import { STATE_MS, StopGate } from "./stop_gate";

describe("the release", () => {
  let stated: boolean[];
  let asked: string[];
  let gate: StopGate;
  const restate = vi.fn<() => void>();
  const seen: StopHold[] = [];
  const release = (postJson: (path: string, body: unknown) => Promise<unknown>) => releaseStop({ gate, postJson, restate, seen });
  const NOTHING = { stop: [] };

  beforeEach(() => {
    vi.useFakeTimers();
    restate.mockClear();
    seen.length = 0;
    stated = [];
    asked = [];
    gate = new StopGate({ stateStop: (engaged) => stated.push(engaged), zero: () => {}, cancelGoals: () => {}, changed: () => {} }, () => 0);
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
    return Promise.resolve(NOTHING);
  };

  it("opens the gate, and states no stop from the first request on", async () => {
    const postJson = (path: string) => {
      asked.push(path);
      if (path === "/_api/stop") vi.advanceTimersByTime(2 * STATE_MS);
      return Promise.resolve(NOTHING);
    };
    await release(postJson);
    expect(asked).toEqual(["/_api/lease", "/_api/stop"]);
    expect([gate.engaged, stated]).toEqual([false, [false, false, false]]);
  });

  it("is overruled by a stop while control is taken", async () => {
    await expect(release(pressDuring("/_api/lease"))).rejects.toThrow("release_overruled");
    expect(asked).toEqual(["/_api/lease"]);
    expect([gate.engaged, gate.isStated, stated]).toEqual([true, true, [true]]);
  });

  it("is overruled by a stop while the server releases", async () => {
    await expect(release(pressDuring("/_api/stop"))).rejects.toThrow("release_overruled");
    expect([gate.engaged, gate.isStated, stated]).toEqual([true, true, [false, true]]);
    expect(restate).toHaveBeenCalledOnce();
  });

  it("states a newer stop again, even if the answer to the release is lost", async () => {
    const postJson = (path: string) => {
      if (path !== "/_api/stop") return Promise.resolve();
      gate.engage("user");
      return Promise.reject(new Error("the answer was lost"));
    };
    await expect(release(postJson)).rejects.toThrow("lost");
    expect(restate).toHaveBeenCalledOnce();
    expect([gate.engaged, gate.isStated]).toEqual([true, true]);
  });

  it("leaves the gate closed where the server refuses", async () => {
    await expect(release(() => Promise.reject(new Error("phone-2 has control")))).rejects.toThrow("phone-2");
    expect([gate.engaged, gate.isStated, stated]).toEqual([true, true, []]);
  });

  const hold = (press: string | null, name: string | null): StopHold => ({ kind: name === null ? "robot" : "pressed", text: "", press, name, age_s: 0 });

  it("releases the presses that the operator has seen, and its own", async () => {
    seen.push(hold("press:other", "phone-2"), hold(null, null));
    const own = gate.press;
    let body: unknown;
    await release((path, sent) => {
      if (path === "/_api/stop") body = sent;
      return Promise.resolve(NOTHING);
    });
    expect(body).toEqual({ engaged: false, presses: [own, "press:other"] });
  });

  it("leaves the gate closed, and says who, where a console still holds the robot", async () => {
    const postJson = () => Promise.resolve({ stop: [hold("press:new", "phone-2"), hold(null, null)] });
    await expect(release(postJson)).rejects.toMatchObject({ phrase: { key: "still_holds", values: { names: "phone-2" } } });
    expect([gate.engaged, gate.isStated]).toEqual([true, false]);
  });

  it("opens the gate where only the robot itself is stopped", async () => {
    await release(() => Promise.resolve({ stop: [hold(null, null)] }));
    expect(gate.engaged).toBe(false);
  });
});
