/** The key of the voice service. It stays in this browser: it is part of no setting and of no request to the console's server. */
import { create } from "zustand";
import { OLDEST_SETTINGS_VERSION, SETTINGS_VERSION } from "@/generated/settings";
import { localStorageOrNull } from "@/storage";

const NAME = "lupin-voice-key";
/** Earlier versions kept the key among the settings, which were not shared then. */
const OLD_OBJECT = (version: number) => `lupin-hmi-settings/v${version}`;
const OLD_FIELD = "geminiApiKey";

type KeyStorage = Pick<Storage, "getItem" | "setItem" | "removeItem">;

interface VoiceKey {
  key: string;
  /** Whether the key is stored beyond this page; the browser's storage may be full or forbidden. */
  isKept: boolean;
}

export const useVoiceKey = create<VoiceKey>(() => {
  const key = readKey(localStorageOrNull());
  return { key, isKept: key !== "" };
});

/** The stored key, also if an earlier version stored it; empty if there is none. */
export function readKey(storage: KeyStorage | null): string {
  const own = read(storage, NAME);
  if (own !== null && own !== "") return own;
  for (let version = SETTINGS_VERSION; version >= OLDEST_SETTINGS_VERSION; version -= 1) {
    const key = oldKey(read(storage, OLD_OBJECT(version)));
    if (key !== "") return key;
  }
  return "";
}

/** Store a key, or delete the stored one if `key` is empty. Returns whether the browser did so. */
export function writeKey(key: string, storage: KeyStorage | null): boolean {
  if (storage === null) return false;
  try {
    if (key === "") {
      storage.removeItem(NAME);
      for (let version = SETTINGS_VERSION; version >= OLDEST_SETTINGS_VERSION; version -= 1) forgetOldKey(storage, OLD_OBJECT(version));
    } else {
      storage.setItem(NAME, key);
    }
    return true;
  } catch {
    return false;
  }
}

export function changeKey(key: string): void {
  const trimmed = key.trim();
  useVoiceKey.setState({ key: trimmed, isKept: writeKey(trimmed, localStorageOrNull()) && trimmed !== "" });
}

function forgetOldKey(storage: KeyStorage, name: string): void {
  const text = read(storage, name);
  if (oldKey(text) === "") return;
  const { [OLD_FIELD]: _, ...rest } = JSON.parse(text ?? "{}") as Record<string, unknown>;
  storage.setItem(name, JSON.stringify(rest));
}

function oldKey(text: string | null): string {
  if (text === null) return "";
  try {
    const object: unknown = JSON.parse(text);
    const key = typeof object === "object" && object !== null ? (object as Record<string, unknown>)[OLD_FIELD] : null;
    return typeof key === "string" ? key : "";
  } catch {
    return "";
  }
}

function read(storage: KeyStorage | null, name: string): string | null {
  try {
    return storage?.getItem(name) ?? null;
  } catch {
    return null;
  }
}
