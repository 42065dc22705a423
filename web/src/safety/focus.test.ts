// @vitest-environment jsdom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { followFocus } from "./focus";

const letGo = vi.fn<() => void>();
const lost = vi.fn<() => void>();
followFocus(letGo, lost);

describe("the focus", () => {
  beforeEach(() => {
    vi.useFakeTimers();
    vi.clearAllMocks();
    window.focus = vi.fn<() => void>();
  });
  afterEach(() => {
    document.body.replaceChildren();
  });

  it("is lost when the window loses it", () => {
    window.dispatchEvent(new Event("blur"));
    expect(letGo).toHaveBeenCalledOnce();
    vi.runAllTimers();
    expect(lost).toHaveBeenCalledOnce();
  });

  it("is fetched back from a frame of the page", () => {
    const frame = document.body.appendChild(document.createElement("iframe"));
    frame.tabIndex = 0;
    frame.focus();
    window.dispatchEvent(new Event("blur"));
    vi.runAllTimers();
    expect(letGo).toHaveBeenCalledOnce();
    expect(lost).not.toHaveBeenCalled();
    expect(window.focus).toHaveBeenCalledOnce();
    expect(document.activeElement).toBe(document.body);
  });
});
