// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { credential } from "./credentials";

describe("the way to the voice service", () => {
  it("is by the console before this browser", () => {
    expect(credential(true, "made-up", false)).toBe("console");
    expect(credential(false, "made-up", false)).toBe("browser");
  });

  it("without a key is a script, and in the mock mode always", () => {
    expect(credential(false, "", false)).toBe("script");
    expect(credential(null, "", false)).toBe("script");
    expect(credential(true, "made-up", true)).toBe("script");
  });
});
