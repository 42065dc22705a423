/** The page's texts: one catalog, in English and Dutch. */
import { useCallback } from "react";
import { create } from "zustand";
import type { SENTENCES } from "@/generated/sentences";
import { localStorageOrNull } from "@/storage";
import { loadWithRetries, preload } from "@/ui/deferred";
import { withDecimalMark, writeNumbersIn } from "@/ui/numbers";
import { type TextKey, texts as english } from "./catalog/english";

export type { TextKey };
export type Language = "en" | "nl";
export const TEXT_KEYS = Object.keys(english) as TextKey[];
export type TextValues = Record<string, string | number>;

const KEY = "lupin-language";

export const LANGUAGES: readonly { value: Language; label: string }[] = [
  { value: "en", label: "English" },
  { value: "nl", label: "Nederlands" },
];

/** Null until the page needed it: only English is loaded with the page. */
let dutch: typeof import("./catalog/dutch") | null = null;

export async function loadDutch(): Promise<void> {
  dutch ??= await import("./catalog/dutch");
}

preload(loadDutch);

/** What this browser chose, or else the first of its own languages. */
export function preferredLanguage(): Language {
  const stored = localStorageOrNull()?.getItem(KEY);
  if (stored === "en" || stored === "nl") return stored;
  return navigator.language.startsWith("nl") ? "nl" : "en";
}

/** The language that is shown. */
export const useLanguage = create<{ language: Language }>(() => ({ language: "en" }));

let chosen: Language = "en";

/** Show a language once its texts are loaded; throws, and shows the one before, if they cannot be. */
export async function setLanguage(language: Language): Promise<void> {
  chosen = language;
  if (language === "nl") await loadWithRetries(loadDutch);
  if (chosen !== language) return;
  writeNumbersIn(language);
  useLanguage.setState({ language });
  document.documentElement.lang = language;
  try {
    localStorageOrNull()?.setItem(KEY, language);
  } catch {
    // Storage is full: the language holds until the page is closed.
  }
}

/** What the robot and the console say, by the name of the sentence. */
export type Sentences = Readonly<Record<keyof typeof SENTENCES, string>>;

/** The sentences in a language; null for English, which is their own, and for what is not loaded. */
export function sentencesIn(language: Language): Sentences | null {
  return language === "nl" ? (dutch?.sentences ?? null) : null;
}

/** A text of the catalog, with `{name}` replaced by the values, and `{name|one|many}` by the word for as many. */
export function textIn(language: Language, key: TextKey, values: TextValues = {}): string {
  const texts = language === "nl" && dutch !== null ? dutch.texts : english;
  return texts[key].replace(PLACE, (whole, name: string, one?: string, many?: string) => {
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
