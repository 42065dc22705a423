/** The named locations that earlier pages kept among this browser's settings. The server keeps them for all browsers now. */
import { OLDEST_SETTINGS_VERSION, SETTINGS_VERSION } from "@/generated/settings";

export const LOCATIONS_FIELD = "voiceNamedLocations";

export const settingsKey = (version: number) => `lupin-hmi-settings/v${version}`;

/** Those of the newest version that has some, by name; what is no object or list is none. The server judges each pose. */
export function storedLocations(storage: Pick<Storage, "getItem"> | null): Record<string, unknown> | null {
  for (let version = SETTINGS_VERSION; version >= OLDEST_SETTINGS_VERSION; version -= 1) {
    const found = read(storage, version)?.[LOCATIONS_FIELD];
    if (Array.isArray(found)) return Object.fromEntries(found.filter((each) => typeof each?.name === "string").map(({ name, ...pose }) => [name, pose]));
    if (typeof found === "object" && found !== null) return found as Record<string, unknown>;
  }
  return null;
}

/** To be called once the server has them. */
export function forgetStoredLocations(storage: Pick<Storage, "getItem" | "setItem"> | null): void {
  for (let version = SETTINGS_VERSION; version >= OLDEST_SETTINGS_VERSION; version -= 1) {
    const stored = read(storage, version);
    if (stored === null || !(LOCATIONS_FIELD in stored)) continue;
    const { [LOCATIONS_FIELD]: _, ...others } = stored;
    try {
      storage?.setItem(settingsKey(version), JSON.stringify(others));
    } catch {
      // In a full storage they stay; the server has them already, and adds none twice.
    }
  }
}

function read(storage: Pick<Storage, "getItem"> | null, version: number): Record<string, unknown> | null {
  try {
    const stored: unknown = JSON.parse(storage?.getItem(settingsKey(version)) ?? "null");
    return typeof stored === "object" && stored !== null && !Array.isArray(stored) ? (stored as Record<string, unknown>) : null;
  } catch {
    return null;
  }
}
