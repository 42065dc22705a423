// @vitest-environment jsdom
import { act } from "react";
import { createRoot } from "react-dom/client";
import { afterEach, describe, expect, it, vi } from "vitest";
import { JointSlider } from "./joint_slider";
import { ARM } from "./joints";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;
HTMLElement.prototype.setPointerCapture = () => {};
Object.defineProperty(HTMLElement.prototype, "clientWidth", { value: 180, configurable: true });

const elbow = ARM[2]!;
const onDrag = vi.fn<(degrees: number) => void>();
const onCommit = vi.fn<(degrees: number) => void>();
const onCancel = vi.fn<() => void>();
let end = () => {};

function show(disabled: boolean): HTMLElement {
  const place = document.createElement("div");
  document.body.append(place);
  const root = createRoot(place);
  act(() =>
    root.render(
      <JointSlider joint={elbow} label="Elbow" endLabels={["", ""]} thumbDeg={10} measuredDeg={10} commandedDeg={undefined} disabled={disabled} onDrag={onDrag} onCommit={onCommit} onCancel={onCancel} />,
    ),
  );
  end = () => {
    act(() => root.unmount());
    place.remove();
  };
  return place.querySelector<HTMLElement>("[role=slider]")!;
}

function pointer(element: HTMLElement, type: string, clientX: number): void {
  act(() => {
    element.dispatchEvent(new MouseEvent(type, { bubbles: true, clientX, button: 0 }));
  });
}

describe("the slider of a joint", () => {
  afterEach(() => {
    end();
    vi.clearAllMocks();
  });

  it("moves nothing when it is pressed anywhere and not dragged", () => {
    const slider = show(false);
    pointer(slider, "pointerdown", 170);
    pointer(slider, "pointerup", 170);
    expect(onDrag).not.toHaveBeenCalled();
    expect(onCommit).not.toHaveBeenCalled();
  });

  it("moves by as much as the pointer is dragged, and sends on release", () => {
    const slider = show(false);
    pointer(slider, "pointerdown", 170);
    pointer(slider, "pointermove", 190);
    expect(onDrag).toHaveBeenLastCalledWith(30);
    expect(onCommit).not.toHaveBeenCalled();
    pointer(slider, "pointerup", 190);
    expect(onCommit).toHaveBeenCalledWith(30);
  });

  it("sends nothing when the drag is cancelled", () => {
    const slider = show(false);
    pointer(slider, "pointerdown", 0);
    pointer(slider, "pointermove", 90);
    pointer(slider, "pointercancel", 90);
    expect(onCommit).not.toHaveBeenCalled();
    expect(onCancel).toHaveBeenCalled();
  });

  it("stays within its limits and obeys the arrow keys", () => {
    const slider = show(false);
    pointer(slider, "pointerdown", 0);
    pointer(slider, "pointermove", 900);
    pointer(slider, "pointerup", 900);
    expect(onCommit).toHaveBeenLastCalledWith(90);
    act(() => void slider.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft", bubbles: true })));
    expect(onCommit).toHaveBeenLastCalledWith(9);
  });

  it("does nothing while it is blocked", () => {
    const slider = show(true);
    pointer(slider, "pointerdown", 0);
    pointer(slider, "pointermove", 90);
    pointer(slider, "pointerup", 90);
    act(() => void slider.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft", bubbles: true })));
    expect(onCommit).not.toHaveBeenCalled();
    expect(slider.getAttribute("aria-disabled")).toBe("true");
  });
});
