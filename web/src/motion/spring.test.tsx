// @vitest-environment jsdom
import { act } from "react";
import { createRoot } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { stepSpring, useSpring } from "./spring";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

describe("a spring", () => {
  it("arrives without swinging past its target", () => {
    let state = { value: 0, speed: 0 };
    for (let step = 0; step < 60; step += 1) {
      state = stepSpring(state, 1, 1 / 60);
      expect(state.value).toBeLessThanOrEqual(1);
    }
    expect(state.value).toBeCloseTo(1, 3);
  });

  it("comes to the same place in one step and in many", () => {
    let many = { value: 0, speed: 2 };
    for (let step = 0; step < 10; step += 1) many = stepSpring(many, 5, 0.02);
    const one = stepSpring({ value: 0, speed: 2 }, 5, 0.2);
    expect(one.value).toBeCloseTo(many.value, 9);
    expect(one.speed).toBeCloseTo(many.speed, 9);
  });
});

describe("useSpring", () => {
  const drawn: number[] = [];
  let frames: FrameRequestCallback[] = [];
  let nowMs = 0;

  function Shown({ value }: { value: number | null }) {
    useSpring(value, (shown) => drawn.push(shown));
    return null;
  }

  function runFrames(count: number): void {
    for (let index = 0; index < count && frames.length > 0; index += 1) {
      nowMs += 16;
      const due = frames;
      frames = [];
      for (const each of due) each(nowMs);
    }
  }

  beforeEach(() => {
    drawn.length = 0;
    frames = [];
    nowMs = 0;
    vi.spyOn(performance, "now").mockImplementation(() => nowMs);
    vi.stubGlobal("requestAnimationFrame", (callback: FrameRequestCallback) => frames.push(callback));
  });

  afterEach(() => vi.unstubAllGlobals());

  function show(values: readonly (number | null)[]): () => void {
    const root = createRoot(document.createElement("div"));
    for (const value of values) act(() => root.render(<Shown value={value} />));
    return () => act(() => root.unmount());
  }

  it("draws the first value at once and then rests", () => {
    const end = show([12, 12]);
    expect(drawn).toEqual([12]);
    expect(frames).toHaveLength(0);
    end();
  });

  it("moves to a new value, and rests when it is there", () => {
    const end = show([0, 10]);
    runFrames(200);
    expect(drawn.length).toBeGreaterThan(5);
    expect(drawn.at(-1)).toBe(10);
    expect(frames).toHaveLength(0);
    end();
  });

  it("shows at once what is unknown, and what is known again", () => {
    const end = show([5, null, 7]);
    expect(drawn).toEqual([5, NaN, 7]);
    expect(frames).toHaveLength(0);
    end();
  });

  it("does not move under reduced motion", () => {
    vi.stubGlobal("matchMedia", () => ({ matches: true }));
    const end = show([0, 10]);
    expect(drawn).toEqual([0, 10]);
    expect(frames).toHaveLength(0);
    end();
  });
});
