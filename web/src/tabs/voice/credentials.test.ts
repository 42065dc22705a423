// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { credential } from "./credentials";

describe("the way to the voice service", () => {
  it("is by the console before this browser", () => {
    expect(credential("auto", true, "made-up", false)).toBe("console");
    expect(credential("auto", false, "made-up", false)).toBe("browser");
  });

  it("without a key is the console itself, which the operator may choose always", () => {
    expect(credential("auto", false, "", false)).toBe("offline");
    expect(credential("auto", null, "", false)).toBe("offline");
    expect(credential("offline", true, "made-up", false)).toBe("offline");
  });

  it("is a script in the mock mode", () => {
    expect(credential("auto", true, "made-up", true)).toBe("script");
    expect(credential("offline", false, "", true)).toBe("script");
  });
});
