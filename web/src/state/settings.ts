/**
 * The page's settings: the server's, which all browsers share, over what this browser stored while it had no server, over the
 * defaults. Older objects of this browser are migrated once.
 */
import { create } from "zustand";
import { useConsole } from "@/api/console_store";
import { ApiError, ask } from "@/api/http";
import { OLDEST_SETTINGS_VERSION, SETTINGS, SETTINGS_VERSION, type Settings } from "@/generated/settings";

const KEY = (version: number) => `lupin-hmi-settings/v${version}`;
/** What browsers stored under these names before version 5 was not their operator's choice. */
const DROPPED_BEFORE_5 = ["polarityInvertHmi", "estopAutoOnFocusLoss"];

type Stored = Partial<Settings>;

const REFUSED_VALUE = 400;

/** The value of a setting now. */
export function setting<Name extends keyof Settings>(name: Name): Settings[Name] {
  return currentSettings()[name];
}

export function useSetting<Name extends keyof Settings>(name: Name): Settings[Name] {
  const shared = useConsole((state) => state.settings[name]);
  return (shared ?? stored[name] ?? SETTINGS[name].default) as Settings[Name];
}

export function currentSettings(): Settings {
  const defaults = Object.fromEntries(Object.entries(SETTINGS).map(([name, row]) => [name, row.default]));
  return { ...defaults, ...stored, ...useConsole.getState().settings } as Settings;
}

/** Where the last change is kept: for all browsers, in this one, or only until this page is closed; and why not for all. */
export interface SettingsPlace {
  place: "shared" | "browser" | "page";
  reason: string;
}

export const useSettingsPlace = create<SettingsPlace>(() => ({ place: "shared", reason: "" }));

/**
 * Change settings for all browsers; where the server cannot keep them, this browser does. Returns whether all have them.
 * Throws ApiError where the server refuses a value.
 */
export async function changeSettings(changes: Stored): Promise<boolean> {
  try {
    await ask("/_api/settings", { version: SETTINGS_VERSION, settings: changes });
    useSettingsPlace.setState({ place: "shared", reason: "" });
    return true;
  } catch (error) {
    if (error instanceof ApiError && error.status === REFUSED_VALUE) throw error;
    Object.assign(stored, changes);
    useSettingsPlace.setState({ place: write(stored) ? "browser" : "page", reason: error instanceof Error ? error.message : String(error) });
    useConsole.setState((state) => ({ settings: { ...state.settings, ...changes } }));
    return false;
  }
}

/** The settings that an object of a version holds: known names with fitting types only. */
export function migrate(version: number, object: unknown): Stored {
  if (typeof object !== "object" || object === null) return {};
  const found: Record<string, unknown> = {};
  for (const [name, value] of Object.entries(object)) {
    const row = (SETTINGS as Record<string, { default: unknown }>)[name];
    if (row === undefined || typeof value !== typeof row.default) continue;
    if (version < SETTINGS_VERSION && DROPPED_BEFORE_5.includes(name)) continue;
    found[name] = value;
  }
  return found as Stored;
}

/** What this browser stored, from the newest version that there is. Storage may be forbidden or damaged. */
export function readStored(storage: Pick<Storage, "getItem"> | null = localStorageOrNull()): Stored {
  for (let version = SETTINGS_VERSION; version >= OLDEST_SETTINGS_VERSION; version -= 1) {
    try {
      const text = storage?.getItem(KEY(version));
      if (text) return migrate(version, JSON.parse(text));
    } catch {
      continue;
    }
  }
  return {};
}

/** Returns whether they are stored. Where storage is full or forbidden, they hold until the page is closed. */
function write(settings: Stored): boolean {
  try {
    const storage = localStorageOrNull();
    storage?.setItem(KEY(SETTINGS_VERSION), JSON.stringify(settings));
    return storage !== null;
  } catch {
    return false;
  }
}

export function localStorageOrNull(): Storage | null {
  try {
    return window.localStorage;
  } catch {
    return null;
  }
}

const stored: Stored = readStored();
