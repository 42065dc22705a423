// @vitest-environment jsdom
import { afterEach, describe, expect, it, vi } from "vitest";
import { useConsole } from "@/api/console_store";
import { changeSettings, currentSettings, migrate, readStored, setting, useSettingsPlace } from "./settings";

const storage = (items: Record<string, string>) => ({ getItem: (key: string) => items[key] ?? null });

describe("settings", () => {
  it("have the defaults of the table", () => {
    expect(currentSettings().cmdVelTopic).toBe("/cmd_vel_manual");
    expect(currentSettings().estopAutoOnFocusLoss).toBe(true);
  });

  it.each([2, 3, 4])("of version %i lose what was not chosen by their operator", (version) => {
    const old = JSON.stringify({ speedScale: 0.7, polarityInvertHmi: true, estopAutoOnFocusLoss: false, rosUrl: "ws://10.42.0.1:9090" });
    expect(readStored(storage({ [`lupin-hmi-settings/v${version}`]: old }))).toEqual({ speedScale: 0.7 });
  });

  it("of version 5 are kept, and the newest version wins", () => {
    const items = {
      "lupin-hmi-settings/v5": JSON.stringify({ polarityInvertHmi: true }),
      "lupin-hmi-settings/v4": JSON.stringify({ speedScale: 0.1 }),
    };
    expect(readStored(storage(items))).toEqual({ polarityInvertHmi: true });
  });

  it.each([
    ["", true],
    ["ws://10.42.0.1:9090", true],
    ["wss://greenhouse.local/_ros", true],
    ["ws://[fd00::1]:9090", true],
    ["http://10.42.0.1:9090", false],
    ["ws://user:secret@10.42.0.1", false],
    ["ws://10.42.0.1:99999", false],
    ["ws://10.42.0.1/?topic=x", false],
    ["greenhouse", false],
  ])("the address %j is allowed: %s", (rosUrl, isAllowed) => {
    expect(migrate(5, { rosUrl })).toEqual(isAllowed ? { rosUrl } : {});
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

  it("of other versions keep allowed values only", () => {
    const wrong = {
      speedScale: 7,
      armRateDegPerSec: -1,
      voiceVadEndHoldMs: 800.5,
      theme: "pink",
      cmdVelType: "geometry_msgs/msg/Pose",
      scanTopic: "/scan; rm",
      voiceLanguage: "x".repeat(100),
      debugPublish: 1,
      toString: "x",
    };
    expect(migrate(5, wrong)).toEqual({});
    expect(migrate(5, { speedScale: Infinity, scanTopic: "/front/scan", theme: "light" })).toEqual({ scanTopic: "/front/scan", theme: "light" });
  });
});

describe("a changed setting", () => {
  afterEach(() => {
    vi.unstubAllGlobals();
    vi.restoreAllMocks();
    useConsole.setState({ settings: {} });
  });

  it("of this browser is stored here, and asks the server for nothing", async () => {
    const fetch = vi.fn<() => Promise<Response>>();
    vi.stubGlobal("fetch", fetch);
    expect(await changeSettings({ theme: "light", estopAutoOnFocusLoss: false })).toBe(true);
    expect(fetch).not.toHaveBeenCalled();
    expect(readStored()).toMatchObject({ theme: "light", estopAutoOnFocusLoss: false });
    // Another browser cannot change it.
    useConsole.setState({ settings: { theme: "dark" } });
    expect(setting("theme")).toBe("light");
  });

  it("of all browsers comes from the server, then from this browser, then from the table", async () => {
    vi.stubGlobal("fetch", () => Promise.reject(new Error("gone")));
    expect(setting("speedScale")).toBe(0.5);
    expect(await changeSettings({ speedScale: 0.25 })).toBe(false);
    expect(useSettingsPlace.getState().place).toBe("browser");
    useConsole.setState({ settings: {} });
    expect(setting("speedScale")).toBe(0.25);
    useConsole.setState({ settings: { speedScale: 0.75 } });
    expect(setting("speedScale")).toBe(0.75);
  });

  it("holds until the page is closed where the storage is full", async () => {
    vi.spyOn(Storage.prototype, "setItem").mockImplementation(() => {
      throw new DOMException("full", "QuotaExceededError");
    });
    expect(await changeSettings({ surfaceContrast: "high" })).toBe(false);
    expect(setting("surfaceContrast")).toBe("high");
    expect(useSettingsPlace.getState().place).toBe("page");
  });
});
