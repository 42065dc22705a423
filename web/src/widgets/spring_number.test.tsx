// @vitest-environment jsdom
import { act } from "react";
import { createRoot } from "react-dom/client";
import { expect, it } from "vitest";
import { SpringNumber } from "./spring_number";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

it("flashes a reading that changed by more than noise, each time anew, and never its first value", async () => {
  const host = document.createElement("p");
  const root = createRoot(host);
  const flashAt = async (value: number | null, flashFrom?: number) => {
    await act(async () => root.render(<SpringNumber value={value} places={2} {...(flashFrom === undefined ? {} : { flashFrom })} />));
    return host.querySelector("span")?.dataset["flash"];
  };
  expect(await flashAt(12, 0.1)).toBeUndefined();
  expect(await flashAt(12.05, 0.1)).toBeUndefined();
  expect(await flashAt(null, 0.1)).toBeUndefined();
  // Slow drift counts from the last flash.
  expect(await flashAt(11.89, 0.1)).toBe("a");
  expect(await flashAt(11.85, 0.1)).toBe("a");
  expect(await flashAt(11.7, 0.1)).toBe("b");
  expect(await flashAt(NaN, 0.1)).toBe("b");
  expect(await flashAt(99)).toBe("b");
  await act(async () => root.unmount());
});
