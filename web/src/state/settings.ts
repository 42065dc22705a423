/**
 * The page's settings. Topics and limits hold for all browsers, and the server keeps those that were changed; look, voice and focus
 * are this browser's own. Where the server has none, or cannot keep one, what this browser stored holds, and then the default.
 * Older objects of this browser are migrated once.
 */
import { create } from "zustand";
import { useConsole } from "@/api/console_store";
import { ApiError, postJson } from "@/api/http";
import { errorText } from "@/i18n/error_text";
import { CommandRefused } from "@/safety/guard";
import { OLDEST_SETTINGS_VERSION, SETTINGS, SETTINGS_VERSION, type Settings } from "@/generated/settings";
import { localStorageOrNull } from "@/storage";
import { LOCATIONS_FIELD, settingsKey, storedLocations } from "./stored_locations";

/** Before version 5, browsers stored these settings although the operator had not chosen them; they are dropped. */
const DROPPED_BEFORE_5 = ["polarityInvertHmi", "estopAutoOnFocusLoss", "rosUrl", "webVideoServerUrl"];

type Stored = Partial<Settings>;
export type SettingName = keyof Settings;

export interface SettingRow {
  default: boolean | number | string;
  unit: string;
  low?: number;
  high?: number;
  choices?: readonly string[];
  ros_name?: boolean;
  /** An address of one of these, or empty. */
  schemes?: readonly string[];
  max_length?: number;
  /** False where each browser keeps its own. */
  shared?: boolean;
}

export function rowOf(name: SettingName): SettingRow {
  return SETTINGS[name];
}

export function isShared(name: SettingName): boolean {
  return rowOf(name).shared !== false;
}

const REFUSED_VALUE = 400;
const ADDRESS = /^([a-z]+):\/\/(?:\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9_.-]{1,253})(?::[0-9]{1,5})?(?:\/[A-Za-z0-9_.~/-]*)?$/;
const ROS_NAME = /^[A-Za-z_/][A-Za-z0-9_/]{0,255}$/;

const useStored = create<{ stored: Stored }>(() => ({ stored: readStored() }));

/** The value of a setting now. */
export function setting<Name extends SettingName>(name: Name): Settings[Name] {
  return valueOf(name, useConsole.getState().settings, useStored.getState().stored);
}

export function useSetting<Name extends SettingName>(name: Name): Settings[Name] {
  const shared = useConsole((state) => state.settings[name]);
  const stored = useStored((state) => state.stored[name]);
  return valueOf(name, { [name]: shared }, { [name]: stored });
}

function valueOf<Name extends SettingName>(name: Name, shared: Stored, stored: Stored): Settings[Name] {
  const own = stored[name] ?? SETTINGS[name].default;
  return ((isShared(name) ? shared[name] : undefined) ?? own) as Settings[Name];
}

export function currentSettings(): Settings {
  const names = Object.keys(SETTINGS) as SettingName[];
  return Object.fromEntries(names.map((name) => [name, setting(name)])) as unknown as Settings;
}

/** Where the last change is kept: where it belongs, in this browser only, or until this page is closed; and why. */
export interface SettingsPlace {
  place: "kept" | "browser" | "page";
  reason: string;
}

export const useSettingsPlace = create<SettingsPlace>(() => ({ place: "kept", reason: "" }));

/**
 * Change settings: those of all browsers at the server, or in this one where the server cannot keep them, and those of this
 * browser here. Returns whether all are kept where they belong. Throws ApiError where the server refuses a value, and CommandRefused.
 */
export async function changeSettings(changes: Stored): Promise<boolean> {
  const names = Object.keys(changes) as SettingName[];
  const own = pick(changes, names.filter((name) => !isShared(name)));
  const shared = pick(changes, names.filter(isShared));
  if (Object.keys(own).length > 0) store(own, "kept", "");
  if (Object.keys(shared).length === 0) return useSettingsPlace.getState().place === "kept";
  try {
    await postJson("/_api/settings", { version: SETTINGS_VERSION, settings: shared });
    useSettingsPlace.setState({ place: "kept", reason: "" });
    return true;
  } catch (error) {
    if (error instanceof CommandRefused || (error instanceof ApiError && error.status === REFUSED_VALUE)) throw error;
    store(shared, "browser", errorText(error));
    useConsole.setState((state) => ({ settings: { ...state.settings, ...shared } }));
    return false;
  }
}

function pick(changes: Stored, names: readonly SettingName[]): Stored {
  return Object.fromEntries(names.map((name) => [name, changes[name]])) as Stored;
}

function store(changes: Stored, place: SettingsPlace["place"], reason: string): void {
  const stored = { ...useStored.getState().stored, ...changes };
  useStored.setState({ stored });
  useSettingsPlace.setState(write(stored) ? { place, reason } : { place: "page", reason });
}

/** Whether the server would accept a value. */
export function isValid(value: unknown, row: SettingRow): boolean {
  if (typeof value !== typeof row.default) return false;
  if (typeof value === "number") {
    const { low = -Infinity, high = Infinity, unit } = row;
    return Number.isFinite(value) && value >= low && value <= high && (unit !== "ms" || Number.isInteger(value));
  }
  if (typeof value !== "string") return true;
  if (row.choices !== undefined) return row.choices.includes(value);
  if (row.schemes !== undefined) return value === "" || (row.schemes.includes(ADDRESS.exec(value)?.[1] ?? "") && URL.canParse(value));
  return row.ros_name === true ? ROS_NAME.test(value) : value.length <= (row.max_length ?? Infinity);
}

/** The settings that an object of a version holds: known names with allowed values only. */
export function migrate(version: number, object: unknown): Stored {
  if (typeof object !== "object" || object === null) return {};
  const found: Record<string, unknown> = {};
  for (const [name, value] of Object.entries(object)) {
    if (!Object.hasOwn(SETTINGS, name) || !isValid(value, rowOf(name as SettingName))) continue;
    if (version < SETTINGS_VERSION && DROPPED_BEFORE_5.includes(name)) continue;
    found[name] = value;
  }
  return found as Stored;
}

/** What this browser stored, from the newest version that there is. Storage may be forbidden or damaged. */
export function readStored(storage: Pick<Storage, "getItem"> | null = localStorageOrNull()): Stored {
  for (let version = SETTINGS_VERSION; version >= OLDEST_SETTINGS_VERSION; version -= 1) {
    try {
      const text = storage?.getItem(settingsKey(version));
      if (text) return migrate(version, JSON.parse(text));
    } catch {
      continue;
    }
  }
  return {};
}

/** Returns whether they are stored. If storage is full or forbidden, they apply until the page is closed. */
function write(settings: Stored): boolean {
  try {
    const storage = localStorageOrNull();
    const locations = storedLocations(storage); // until the server has them
    storage?.setItem(settingsKey(SETTINGS_VERSION), JSON.stringify(locations === null ? settings : { ...settings, [LOCATIONS_FIELD]: locations }));
    return storage !== null;
  } catch {
    return false;
  }
}
