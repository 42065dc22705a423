// @vitest-environment jsdom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { isSoftwareRenderer } from "./webgl";

describe("WebGL", () => {
  it.each([
    ["ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero)), SwiftShader driver)", true],
    ["Mesa/X.org, llvmpipe (LLVM 15.0.6, 256 bits)", true],
    ["Gallium 0.4 on softpipe", true],
    ["Apple Software Renderer", true],
    ["ANGLE (Microsoft, Microsoft Basic Render Driver Direct3D11 vs_5_0 ps_5_0)", true],
    ["ANGLE (Intel, Mesa Intel(R) Iris(R) Xe Graphics, OpenGL 4.6)", false],
  ])("in %s is computed by the processor: %s", (name, expected) => {
    expect(isSoftwareRenderer(name)).toBe(expected);
  });
});

describe("a browser's WebGL", () => {
  const loseContext = vi.fn<() => void>();

  /** A browser that gives contexts of a renderer; with a caveat, only if asked for any. */
  function give(renderer: string | null, hasCaveat = false): void {
    const context = {
      RENDERER: 1,
      getParameter: () => renderer,
      getExtension: (name: string) => (name === "WEBGL_lose_context" ? { loseContext } : null),
    };
    const getContext = (_kind: string, options: WebGLContextAttributes) =>
      renderer === null || (hasCaveat && options.failIfMajorPerformanceCaveat === true) ? null : context;
    vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockImplementation(getContext as never);
  }

  beforeEach(() => {
    vi.resetModules();
    loseContext.mockClear();
  });

  afterEach(() => vi.restoreAllMocks());

  it.each([
    ["a graphics processor", "Iris", false, { there: true, software: false }],
    ["a caveat", "unnamed", true, { there: true, software: true }],
    ["software without a caveat", "SwiftShader", false, { there: true, software: true }],
    ["none", null, false, { there: false, software: true }],
  ])("with %s", async (_name, renderer, hasCaveat, expected) => {
    give(renderer, hasCaveat);
    const { drawsInSoftware, hasWebGl } = await import("./webgl");
    expect({ there: hasWebGl(), software: drawsInSoftware() }).toEqual(expected);
    const asked = vi.mocked(HTMLCanvasElement.prototype.getContext).mock.calls.length;
    hasWebGl();
    expect(vi.mocked(HTMLCanvasElement.prototype.getContext)).toHaveBeenCalledTimes(asked);
    expect(loseContext.mock.calls.length > 0).toBe(renderer !== null);
  });

  it("with an extension that lets no page look, by throwing", async () => {
    vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockImplementation(() => {
      throw new Error("blocked");
    });
    const { drawsInSoftware, hasWebGl } = await import("./webgl");
    expect({ there: hasWebGl(), software: drawsInSoftware() }).toEqual({ there: false, software: true });
  });
});
