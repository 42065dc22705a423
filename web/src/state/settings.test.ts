// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { currentSettings, migrate, readStored } from "./settings";

const storage = (items: Record<string, string>) => ({ getItem: (key: string) => items[key] ?? null });

describe("settings", () => {
  it("have the defaults of the table", () => {
    expect(currentSettings().cmdVelTopic).toBe("/cmd_vel_manual");
    expect(currentSettings().estopAutoOnFocusLoss).toBe(true);
  });

  it.each([2, 3, 4])("of version %i lose what was not chosen by their operator", (version) => {
    const old = JSON.stringify({ speedScale: 0.7, polarityInvertHmi: true, estopAutoOnFocusLoss: false });
    expect(readStored(storage({ [`lupin-hmi-settings/v${version}`]: old }))).toEqual({ speedScale: 0.7 });
  });

  it("of version 5 are kept, and the newest version wins", () => {
    const items = {
      "lupin-hmi-settings/v5": JSON.stringify({ polarityInvertHmi: true }),
      "lupin-hmi-settings/v4": JSON.stringify({ speedScale: 0.1 }),
    };
    expect(readStored(storage(items))).toEqual({ polarityInvertHmi: true });
  });

  it.each(["{", "null", "[]", '"x"', '{"speedScale":"fast","nonsense":1}'])("survive the stored text %s", (text) => {
    expect(readStored(storage({ "lupin-hmi-settings/v5": text }))).toEqual({});
  });

  it("survive forbidden storage", () => {
    const forbidden = {
      getItem: () => {
        throw new DOMException("denied");
      },
    };
    expect(readStored(forbidden)).toEqual({});
    expect(readStored(null)).toEqual({});
    expect(migrate(5, undefined)).toEqual({});
  });
});
