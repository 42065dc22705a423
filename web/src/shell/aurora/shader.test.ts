// @vitest-environment jsdom
import { afterEach, expect, it, vi } from "vitest";
import { createShader } from "./shader";

const isSoftware = vi.hoisted(() => ({ value: false }));
vi.mock("@/widgets/webgl", () => ({ drawsInSoftware: () => isSoftware.value, releaseContext: () => {} }));

afterEach(() => vi.restoreAllMocks());

it.each([
  ["no context at all without a graphics processor", true, 0],
  ["only a context without a caveat", false, 1],
])("the aurora asks for %s", (_name, software, asked) => {
  isSoftware.value = software;
  const getContext = vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockReturnValue(null);
  expect(createShader(document.createElement("canvas"))).toBeNull();
  expect(getContext).toHaveBeenCalledTimes(asked);
  if (asked > 0) expect(getContext.mock.calls[0]?.[1]).toMatchObject({ failIfMajorPerformanceCaveat: true });
});
