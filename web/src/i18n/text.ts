/** The page's texts: one catalog, in English and Dutch. */
import { useCallback } from "react";
import { create } from "zustand";
import { localStorageOrNull } from "@/storage";
import { withDecimalMark, writeNumbersIn } from "@/ui/numbers";
import { arm } from "./catalog/en/arm";
import { arm as armDutch } from "./catalog/nl/arm";
import { boot } from "./catalog/en/boot";
import { boot as bootDutch } from "./catalog/nl/boot";
import { cameras } from "./catalog/en/cameras";
import { cameras as camerasDutch } from "./catalog/nl/cameras";
import { doctor } from "./catalog/en/doctor";
import { doctor as doctorDutch } from "./catalog/nl/doctor";
import { logs } from "./catalog/en/logs";
import { logs as logsDutch } from "./catalog/nl/logs";
import { map } from "./catalog/en/map";
import { map as mapDutch } from "./catalog/nl/map";
import { mission } from "./catalog/en/mission";
import { mission as missionDutch } from "./catalog/nl/mission";
import { palette } from "./catalog/en/palette";
import { palette as paletteDutch } from "./catalog/nl/palette";
import { places } from "./catalog/en/places";
import { places as placesDutch } from "./catalog/nl/places";
import { rewind } from "./catalog/en/rewind";
import { rewind as rewindDutch } from "./catalog/nl/rewind";
import { runs } from "./catalog/en/runs";
import { runs as runsDutch } from "./catalog/nl/runs";
import { settings } from "./catalog/en/settings";
import { settings as settingsDutch } from "./catalog/nl/settings";
import { shell } from "./catalog/en/shell";
import { shell as shellDutch } from "./catalog/nl/shell";
import { stop } from "./catalog/en/stop";
import { stop as stopDutch } from "./catalog/nl/stop";
import { telemetry } from "./catalog/en/telemetry";
import { telemetry as telemetryDutch } from "./catalog/nl/telemetry";
import { teleop } from "./catalog/en/teleop";
import { teleop as teleopDutch } from "./catalog/nl/teleop";
import { voice } from "./catalog/en/voice";
import { voice as voiceDutch } from "./catalog/nl/voice";

const english = {
  ...arm,
  ...boot,
  ...cameras,
  ...doctor,
  ...logs,
  ...map,
  ...mission,
  ...palette,
  ...places,
  ...rewind,
  ...runs,
  ...settings,
  ...shell,
  ...stop,
  ...telemetry,
  ...teleop,
  ...voice,
};
const dutch: Record<TextKey, string> = {
  ...armDutch,
  ...bootDutch,
  ...camerasDutch,
  ...doctorDutch,
  ...logsDutch,
  ...mapDutch,
  ...missionDutch,
  ...paletteDutch,
  ...placesDutch,
  ...rewindDutch,
  ...runsDutch,
  ...settingsDutch,
  ...shellDutch,
  ...stopDutch,
  ...telemetryDutch,
  ...teleopDutch,
  ...voiceDutch,
};

export type TextKey = keyof typeof english;
export type Language = "en" | "nl";
export const TEXT_KEYS = Object.keys(english) as TextKey[];
export type TextValues = Record<string, string | number>;

const CATALOG: Record<Language, Record<TextKey, string>> = { en: english, nl: dutch };
const KEY = "lupin-language";

export const LANGUAGES: readonly { value: Language; label: string }[] = [
  { value: "en", label: "English" },
  { value: "nl", label: "Nederlands" },
];

function preferredLanguage(): Language {
  const stored = localStorageOrNull()?.getItem(KEY);
  if (stored === "en" || stored === "nl") return stored;
  return navigator.language.startsWith("nl") ? "nl" : "en";
}

export const useLanguage = create<{ language: Language }>(() => ({ language: preferredLanguage() }));
writeNumbersIn(useLanguage.getState().language);

export function setLanguage(language: Language): void {
  writeNumbersIn(language);
  useLanguage.setState({ language });
  document.documentElement.lang = language;
  try {
    localStorageOrNull()?.setItem(KEY, language);
  } catch {
    // Storage is full: the language holds until the page is closed.
  }
}

/** A text of the catalog, with `{name}` replaced by the values, and `{name|one|many}` by the word for as many. */
export function textIn(language: Language, key: TextKey, values: TextValues = {}): string {
  return CATALOG[language][key].replace(PLACE, (whole, name: string, one?: string, many?: string) => {
    const value = values[name];
    if (one !== undefined && many !== undefined) return value === 1 ? one : many;
    return typeof value === "number" ? withDecimalMark(String(value)) : (value ?? whole);
  });
}

const PLACE = /\{(\w+)(?:\|([^|}]*)\|([^|}]*))?\}/g;

export type Text = (key: TextKey, values?: TextValues) => string;

/** The function that returns texts in the language of the page. */
export function useText(): Text {
  const language = useLanguage((state) => state.language);
  return useCallback((key, values) => textIn(language, key, values), [language]);
}
