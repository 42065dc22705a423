// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { readKey, writeKey } from "./voice_key";

function storage(items: Record<string, string>) {
  const map = new Map(Object.entries(items));
  return {
    map,
    getItem: (name: string) => map.get(name) ?? null,
    setItem: (name: string, value: string) => void map.set(name, value),
    removeItem: (name: string) => void map.delete(name),
  };
}

describe("the key of the voice service", () => {
  it("is stored and forgotten in this browser", () => {
    const browser = storage({});
    expect(writeKey("made-up", browser)).toBe(true);
    expect(readKey(browser)).toBe("made-up");
    expect(writeKey("", browser)).toBe(true);
    expect(readKey(browser)).toBe("");
  });

  it("is taken over from older settings, and forgotten there, too", () => {
    const browser = storage({ "lupin-hmi-settings/v4": JSON.stringify({ geminiApiKey: "made-up", speedScale: 0.7 }) });
    expect(readKey(browser)).toBe("made-up");
    writeKey("", browser);
    expect(readKey(browser)).toBe("");
    expect(browser.map.get("lupin-hmi-settings/v4")).toBe('{"speedScale":0.7}');
  });

  it("survives damaged and forbidden storage", () => {
    expect(readKey(storage({ "lupin-hmi-settings/v5": "{" }))).toBe("");
    expect(readKey(null)).toBe("");
    const full = {
      ...storage({}),
      setItem: () => {
        throw new DOMException("full");
      },
    };
    expect(writeKey("made-up", full)).toBe(false);
    expect(writeKey("made-up", null)).toBe(false);
  });
});
