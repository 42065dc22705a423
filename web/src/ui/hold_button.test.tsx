// @vitest-environment jsdom
import { act } from "react";
import { type Root, createRoot } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { HOLD_MS, HoldButton } from "./hold_button";

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
  const press = (button_: number) =>
    act(() => {
      const event = new MouseEvent("pointerdown", { bubbles: true, button: button_ });
      Object.assign(event, { isPrimary: true });
      button().dispatchEvent(event);
    });
  const click = (detail: number) =>
    act(() => {
      button().dispatchEvent(new MouseEvent("click", { bubbles: true, detail }));
    });
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
    wait(HOLD_MS - 1);
    expect(onHeld).not.toHaveBeenCalled();
    wait(1);
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
    const key = (type: string, name: string, repeat = false) =>
      act(() => {
        button().dispatchEvent(new KeyboardEvent(type, { bubbles: true, key: name, repeat }));
      });
    key("keydown", " ");
    wait(2 * HOLD_MS);
    key("keyup", " ");
    expect(onHeld).not.toHaveBeenCalled();
    key("keydown", "Enter");
    key("keydown", "Enter", true);
    wait(2 * HOLD_MS);
    key("keydown", "Enter", true);
    key("keyup", "Enter");
    expect(onHeld).toHaveBeenCalledOnce();
  });

  it("forgets a click that nobody confirms", () => {
    click(0);
    wait(10_000);
    expect(button().textContent).toBe("Hold to release");
    click(0);
    expect(onHeld).not.toHaveBeenCalled();
  });
});
