import { describe, expect, it } from "vitest";
import { forgetStoredLocations, storedLocations } from "./stored_locations";

const POSE = { x: 1, y: 2, yaw: 0.5 };

function storage(items: Record<string, unknown>) {
  const texts = new Map(Object.entries(items).map(([version, value]) => [`lupin-hmi-settings/${version}`, typeof value === "string" ? value : JSON.stringify(value)]));
  return { texts, getItem: (key: string) => texts.get(key) ?? null, setItem: (key: string, text: string) => void texts.set(key, text) };
}

describe("named locations that a browser stored", () => {
  it("are those of the newest version that has some", () => {
    expect(storedLocations(storage({ v5: { theme: "light" }, v4: { voiceNamedLocations: { dock: POSE } }, v3: { voiceNamedLocations: {} } }))).toEqual({ dock: POSE });
    expect(storedLocations(storage({ v5: { voiceNamedLocations: [{ name: "dock", ...POSE }, null, { x: 1 }] } }))).toEqual({ dock: POSE });
  });

  it("may be missing, damaged or forbidden", () => {
    for (const stored of [{}, { v5: "{" }, { v5: "[]" }, { v5: { voiceNamedLocations: "dock" } }]) expect(storedLocations(storage(stored))).toBeNull();
    expect(storedLocations(null)).toBeNull();
  });

  it("are forgotten once the server has them, and no setting with them", () => {
    const kept = storage({ v5: { theme: "light", voiceNamedLocations: { dock: POSE } }, v3: { voiceNamedLocations: {} } });
    forgetStoredLocations(kept);
    expect(storedLocations(kept)).toBeNull();
    expect(kept.texts.get("lupin-hmi-settings/v5")).toBe('{"theme":"light"}');
  });
});
