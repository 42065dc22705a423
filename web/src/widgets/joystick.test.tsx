// @vitest-environment jsdom
import { act } from "react";
import { type Root, createRoot } from "react-dom/client";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Joystick } from "./joystick";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

describe("a joystick", () => {
  const onMove = vi.fn<(right: number, up: number) => void>();
  let container: HTMLDivElement;
  let root: Root;

  const show = (disabled: boolean) => act(() => root.render(<Joystick label="move" disabled={disabled} onMove={onMove} />));
  const pad = () => container.querySelector("[role=application]") as HTMLDivElement;
  const pointer = (kind: string, x: number, y: number, button = 0) =>
    act(() => {
      pad().dispatchEvent(new MouseEvent(kind, { bubbles: true, clientX: x, clientY: y, button }));
    });

  beforeEach(() => {
    onMove.mockClear();
    container = document.body.appendChild(document.createElement("div"));
    root = createRoot(container);
    HTMLElement.prototype.setPointerCapture = () => {};
    HTMLElement.prototype.getBoundingClientRect = () => ({ left: 0, top: 0, width: 100, height: 100 }) as DOMRect;
  });

  afterEach(() => act(() => root.unmount()));

  it("shows what the keys do, and moves nothing by that", () => {
    act(() => root.render(<Joystick label="move" disabled={false} shown={{ right: 1, up: 0.5 }} onMove={onMove} />));
    expect(container.querySelector<HTMLElement>("[style]")?.style.transform).toBe("translate(calc(-50% + 106%), calc(-50% + -53%))");
    expect(onMove).not.toHaveBeenCalled();
  });

  it("moves by the primary button and springs back", () => {
    show(false);
    pointer("pointerdown", 50, 14, 2);
    expect(onMove).not.toHaveBeenCalled();
    pointer("pointerdown", 50, 14);
    expect(onMove.mock.lastCall?.[1]).toBeCloseTo(1);
    pointer("pointerup", 50, 14);
    expect(onMove.mock.lastCall).toEqual([0, 0]);
  });

  it("is let go when it leaves the page", () => {
    show(false);
    pointer("pointerdown", 50, 14);
    act(() => root.render(null));
    expect(onMove.mock.lastCall).toEqual([0, 0]);
  });

  it("is let go when it is disabled, and not moved again by the same hold", () => {
    show(false);
    pointer("pointerdown", 50, 14);
    show(true);
    expect(onMove.mock.lastCall).toEqual([0, 0]);
    show(false);
    onMove.mockClear();
    pointer("pointermove", 50, 20);
    expect(onMove).not.toHaveBeenCalled();
  });
});
