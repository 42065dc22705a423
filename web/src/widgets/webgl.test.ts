// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { isSoftwareRenderer } from "./webgl";

describe("WebGL", () => {
  it.each([
    ["ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero)), SwiftShader driver)", true],
    ["Mesa/X.org, llvmpipe (LLVM 15.0.6, 256 bits)", true],
    ["ANGLE (Intel, Mesa Intel(R) Iris(R) Xe Graphics, OpenGL 4.6)", false],
  ])("in %s is computed by the processor: %s", (name, expected) => {
    expect(isSoftwareRenderer(name)).toBe(expected);
  });
});
