// @vitest-environment jsdom
import { act } from "react";
import { type Root, createRoot } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { HOLD_MS, HoldButton } from "@/ui/hold_button";
import { useGate } from "@/robot/stop";
import { MirroredStop, PlainStop } from "./stop_bar";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

const acted = vi.fn<() => void>();
let container: HTMLDivElement;
let root: Root;
let pressesBefore = 0;

const find = (selector: string) => container.querySelector<HTMLElement>(selector) as HTMLElement;
const presses = () => useGate.getState().presses - pressesBefore;

function send(target: EventTarget, event: Event, atMs?: number): Event {
  if (atMs !== undefined) Object.defineProperty(event, "timeStamp", { value: atMs });
  act(() => {
    target.dispatchEvent(event);
  });
  return event;
}

function key(target: EventTarget, type: "keydown" | "keyup", init: KeyboardEventInit = {}): Event {
  return send(target, new KeyboardEvent(type, { bubbles: true, cancelable: true, code: "Space", key: " ", ...init }));
}

function pointer(type: string, atMs: number, init: PointerEventInit = {}): Event {
  return send(find("[data-stop]"), new PointerEvent(type, { bubbles: true, isPrimary: true, ...init }), atMs);
}

function click(detail: number, atMs: number): void {
  send(find("[data-stop]"), new MouseEvent("click", { bubbles: true, detail }), atMs);
}

beforeEach(() => {
  vi.stubGlobal("fetch", () => Promise.reject(new Error("no server")));
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
  acted.mockClear();
  container = document.body.appendChild(document.createElement("div"));
  root = createRoot(container);
  act(() =>
    root.render(
      <>
        <HoldButton onHeld={acted}>Hold to abort</HoldButton>
        <button type="button" data-testid="other" onClick={acted}>
          Resume
        </button>
        <input aria-label="Name" />
        <PlainStop />
        <MirroredStop />
      </>,
    ),
  );
  pressesBefore = useGate.getState().presses;
});

afterEach(() => {
  act(() => root.unmount());
  container.remove();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("the space bar", () => {
  it.each(["button", "[data-testid=other]", "[data-stop]"])("stops once and presses nothing if %s has the focus", (selector) => {
    const target = find(selector);
    const events = [key(target, "keydown"), key(target, "keydown", { repeat: true })];
    act(() => vi.advanceTimersByTime(2 * HOLD_MS));
    events.push(key(target, "keyup"));
    expect(events.map((event) => event.defaultPrevented)).toEqual([true, true, true]);
    expect(presses()).toBe(1);
    expect(acted).not.toHaveBeenCalled();
  });

  it("stops from on-screen keyboards, which name no place of the key", () => {
    key(document.body, "keydown", { code: "" });
    expect(presses()).toBe(1);
  });

  it("is text where text is typed", () => {
    expect(key(find("input"), "keydown").defaultPrevented).toBe(false);
    expect(key(find("input"), "keyup").defaultPrevented).toBe(false);
    expect(presses()).toBe(0);
  });
});

describe("the stop button", () => {
  it("stops at the press, which counts once with its click, however long it takes", () => {
    pointer("pointerdown", 1000);
    expect(presses()).toBe(1);
    pointer("pointerup", 9000);
    click(1, 9010);
    expect(presses()).toBe(1);
    pointer("pointerdown", 9200);
    expect(presses()).toBe(2);
  });

  it("stops at the touch of a finger, which leaves before its click", () => {
    pointer("pointerdown", 1000);
    pointer("pointerup", 1080);
    pointer("pointerout", 1080);
    click(1, 1300);
    expect(presses()).toBe(1);
  });

  it.each([0, 1])("stops by a click without a press, of detail %d", (detail) => {
    click(detail, 1000);
    click(detail, 1001);
    expect(presses()).toBe(2);
  });

  it("stops by click()", () => {
    act(() => find("[data-stop]").click());
    expect(presses()).toBe(1);
  });

  it.each(["pointerup", "pointerout"])("stops by a click after a press that ended by %s without one", (end) => {
    pointer("pointerdown", 1000);
    pointer(end, 1200);
    click(1, 2000);
    expect(presses()).toBe(2);
  });

  it("ignores the other buttons of a mouse", () => {
    pointer("pointerdown", 1000, { button: 2 });
    expect(presses()).toBe(0);
  });
});

describe("the mirrored stop", () => {
  it("stops at the press, and by click()", () => {
    const button = find("[data-testid=stop-mirrored]");
    send(button, new PointerEvent("pointerdown", { bubbles: true, isPrimary: true }), 1000);
    send(button, new PointerEvent("pointerup", { bubbles: true, isPrimary: true }), 1100);
    send(button, new MouseEvent("click", { bubbles: true, detail: 1 }), 1101);
    expect(presses()).toBe(1);
    act(() => button.click());
    expect(presses()).toBe(2);
  });
});
