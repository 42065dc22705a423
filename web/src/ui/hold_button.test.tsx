// @vitest-environment jsdom
import { act } from "react";
import { type Root, createRoot } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { HOLD_MS, HoldButton } from "./hold_button";
import { endHolds } from "./holds";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

describe("a button to be held", () => {
  const onHeld = vi.fn<() => void>();
  let container: HTMLDivElement;
  let root: Root;

  const show = (disabled = false) =>
    act(() =>
      root.render(
        <HoldButton disabled={disabled} onHeld={onHeld}>
          Hold to release
        </HoldButton>,
      ),
    );
  const button = () => container.querySelector("button") as HTMLButtonElement;
  /** The time of events; React takes that of an event at 0 for unknown. */
  const nowMs = () => 1000 + performance.now();
  const send = (event: Event, atMs: number) =>
    act(() => {
      Object.defineProperty(event, "timeStamp", { value: atMs });
      button().dispatchEvent(event);
    });
  const pointer = (type: string, atMs = nowMs(), init: PointerEventInit = {}) => send(new PointerEvent(type, { bubbles: true, isPrimary: true, ...init }), atMs);
  const press = (button_: number) => pointer("pointerdown", nowMs(), { button: button_ });
  const key = (type: string, name: string, atMs: number, repeat = false) => send(new KeyboardEvent(type, { bubbles: true, key: name, repeat }), atMs);
  const click = (detail: number, atMs = nowMs()) => send(new MouseEvent("click", { bubbles: true, detail }), atMs);
  const wait = (ms: number) => act(() => vi.advanceTimersByTime(ms));

  beforeEach(() => {
    vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "performance"] });
    onHeld.mockClear();
    container = document.body.appendChild(document.createElement("div"));
    root = createRoot(container);
    show();
  });

  afterEach(() => {
    act(() => root.unmount());
    container.remove();
    vi.useRealTimers();
  });

  it("acts after it was held by the primary button only", () => {
    press(2);
    wait(2 * HOLD_MS);
    expect(onHeld).not.toHaveBeenCalled();
    press(0);
    wait(HOLD_MS);
    expect(onHeld).not.toHaveBeenCalled();
    wait(50);
    expect(onHeld).toHaveBeenCalledOnce();
    pointer("pointerup");
    expect(onHeld).toHaveBeenCalledOnce();
  });

  it("does not act when it is disabled while it is held", () => {
    press(0);
    wait(HOLD_MS / 2);
    show(true);
    wait(HOLD_MS);
    show(false);
    wait(HOLD_MS);
    expect(onHeld).not.toHaveBeenCalled();
  });

  it("does not act after a stop, however it was begun", () => {
    press(0);
    wait(HOLD_MS - 100);
    act(endHolds);
    wait(HOLD_MS);
    pointer("pointerup");
    click(0);
    act(endHolds);
    wait(1000);
    click(0);
    expect(onHeld).not.toHaveBeenCalled();
  });

  it("asks what cannot hold it for a second click", () => {
    click(1);
    expect(button().textContent).toBe("Hold to release");
    click(0);
    expect(button().textContent).toBe("Press again to confirm");
    wait(100);
    click(0);
    expect(onHeld).not.toHaveBeenCalled();
    wait(1000);
    click(0);
    expect(onHeld).toHaveBeenCalledOnce();
    expect(button().textContent).toBe("Hold to release");
  });

  it("asks again after a double click, of which the second one is handled late", () => {
    click(0, 1000);
    wait(2000);
    click(0, 1100);
    expect(onHeld).not.toHaveBeenCalled();
  });

  it("forgets a click once the focus is elsewhere, and keeps it while the pointer passes over", () => {
    button().focus();
    click(0);
    act(() => {
      button().dispatchEvent(new MouseEvent("pointerout", { bubbles: true }));
    });
    expect(button().textContent).toBe("Press again to confirm");
    act(() => button().blur());
    expect(button().textContent).toBe("Hold to release");
    wait(60_000);
    click(0);
    expect(onHeld).not.toHaveBeenCalled();
  });

  it("is held by Enter, and not by Space", () => {
    key("keydown", " ", 1000);
    wait(2 * HOLD_MS);
    key("keyup", " ", 3400);
    expect(onHeld).not.toHaveBeenCalled();
    key("keydown", "Enter", 4000);
    key("keydown", "Enter", 4500, true);
    wait(2 * HOLD_MS);
    key("keydown", "Enter", 6300, true);
    key("keyup", "Enter", 6400);
    expect(onHeld).toHaveBeenCalledOnce();
  });

  // While a page is blocked, neither its timers nor its events are handled; afterwards they are, in any order.
  it("acts at the release of a hold that was long enough, of which the page saw nothing while it was blocked", () => {
    pointer("pointerdown", 1000);
    pointer("pointerup", 1000 + HOLD_MS);
    expect(onHeld).toHaveBeenCalledOnce();
    key("keydown", "Enter", 5000);
    key("keyup", "Enter", 5000 + HOLD_MS);
    expect(onHeld).toHaveBeenCalledTimes(2);
    wait(2 * HOLD_MS);
    expect(onHeld).toHaveBeenCalledTimes(2);
  });

  it("does not act if its late timer ends before the release of a short hold is handled", () => {
    pointer("pointerdown", 1000);
    wait(HOLD_MS);
    pointer("pointerup", 1500);
    wait(2 * HOLD_MS);
    expect(onHeld).not.toHaveBeenCalled();
    expect(button().dataset["timesHeld"]).toBe("0");
  });

  it("does not act if its press and the release of a short hold are handled late", () => {
    wait(3000);
    pointer("pointerdown", 1000);
    wait(500);
    pointer("pointerup", 1500);
    wait(2 * HOLD_MS);
    expect(onHeld).not.toHaveBeenCalled();
  });

  it.each(["pointerout", "pointercancel"])("does not act after %s, however late", (type) => {
    pointer("pointerdown", 1000);
    pointer(type, 3000);
    pointer("pointerup", 3000);
    wait(2 * HOLD_MS);
    expect(onHeld).not.toHaveBeenCalled();
  });

  it("does not act at the release after it was disabled", () => {
    pointer("pointerdown", 1000);
    show(true);
    show(false);
    pointer("pointerup", 3000);
    expect(onHeld).not.toHaveBeenCalled();
  });

  it("forgets a click that nobody confirms", () => {
    click(0);
    wait(10_000);
    expect(button().textContent).toBe("Hold to release");
    click(0);
    expect(onHeld).not.toHaveBeenCalled();
  });
});
