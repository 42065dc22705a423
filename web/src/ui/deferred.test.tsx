// @vitest-environment jsdom
import { Suspense, act } from "react";
import { createRoot } from "react-dom/client";
import { describe, expect, it, vi } from "vitest";
import { Boundary } from "./boundary";
import { deferred, loadWithRetries } from "./deferred";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

describe("a part that is loaded later", () => {
  it("is asked for again while its server is away", async () => {
    const load = vi.fn<() => Promise<string>>().mockRejectedValueOnce(new Error("gone")).mockRejectedValueOnce(new Error("gone")).mockResolvedValue("part");
    await expect(loadWithRetries(load, [0, 0, 0])).resolves.toBe("part");
    expect(load).toHaveBeenCalledTimes(3);
  });

  it("fails with the last reason after its last try", async () => {
    const load = vi.fn<() => Promise<string>>().mockRejectedValue(new Error("gone"));
    await expect(loadWithRetries(load, [0, 0])).rejects.toThrow("gone");
    expect(load).toHaveBeenCalledTimes(3);
  });

  it("is loaded again when a person tries again", async () => {
    vi.useFakeTimers();
    vi.spyOn(console, "error").mockImplementation(() => {});
    let isAway = true;
    const load = vi.fn<() => Promise<{ default: () => string }>>(() => (isAway ? Promise.reject(new Error("gone")) : Promise.resolve({ default: () => "here" })));
    const Part = deferred(load);
    const place = document.createElement("div");
    const root = createRoot(place);
    const Retry = ({ onRetry }: { onRetry: () => void }) => (
      <button type="button" onClick={onRetry}>
        again
      </button>
    );
    act(() => {
      root.render(
        <Boundary fallback={Retry}>
          <Suspense>
            <Part />
          </Suspense>
        </Boundary>,
      );
    });
    await act(() => vi.advanceTimersByTimeAsync(60_000));
    expect(place.textContent).toBe("again");
    isAway = false;
    act(() => place.querySelector("button")?.click());
    await act(() => vi.advanceTimersByTimeAsync(1000));
    expect(place.textContent).toBe("here");
    act(() => root.unmount());
    vi.useRealTimers();
  });
});
