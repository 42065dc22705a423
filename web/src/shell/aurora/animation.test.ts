// @vitest-environment jsdom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { animate } from "./animation";
import { LOOKS, type Look } from "./mood";
import { createShader } from "./shader";

vi.mock("./shader", () => ({ createShader: vi.fn() }));

const drawn: Look[] = [];

function startOn(isSoftware: boolean) {
  vi.mocked(createShader).mockReturnValue({ isSoftware, draw: (look) => drawn.push(look), resize: () => {} });
  return animate(document.createElement("canvas"), LOOKS.calm);
}

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["requestAnimationFrame", "cancelAnimationFrame", "performance"] });
  vi.stubGlobal("matchMedia", () => Object.assign(new EventTarget(), { matches: false }));
  drawn.length = 0;
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the aurora", () => {
  it("drifts where a graphics processor draws it, and ends", () => {
    const animation = startOn(false);
    vi.advanceTimersByTime(1000);
    const calm = drawn.length;
    expect(calm).toBeGreaterThan(5);
    expect(calm).toBeLessThan(15);
    animation.show(LOOKS.stopped);
    vi.advanceTimersByTime(1000);
    expect(drawn.length - calm).toBeGreaterThan(20);
    expect(drawn.at(-1)?.stop).toBeLessThan(1);
    animation.end();
    const ended = drawn.length;
    vi.advanceTimersByTime(1000);
    expect(drawn.length).toBe(ended);
  });

  it("is drawn once for each mood and each size where the CPU computes its pixels", () => {
    const animation = startOn(true);
    vi.advanceTimersByTime(1000);
    expect(drawn).toEqual([LOOKS.calm]);
    animation.show(LOOKS.stopped);
    animation.show(LOOKS.stopped);
    vi.advanceTimersByTime(1000);
    expect(drawn).toEqual([LOOKS.calm, LOOKS.stopped]);
    window.dispatchEvent(new Event("resize"));
    vi.advanceTimersByTime(1000);
    expect(drawn).toEqual([LOOKS.calm, LOOKS.stopped, LOOKS.stopped]);
    animation.end();
  });
});
