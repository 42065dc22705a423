import { wordsIn } from "./robot_words";
import { textIn, useLanguage } from "./text";
import { WordedError } from "./text_error";

/** What to tell a person of an error: the catalog's text in the language of the page, or the robot's or the server's own words. */
export function errorText(error: unknown): string {
  if (error instanceof WordedError && error.phrase !== null) return textIn(useLanguage.getState().language, error.phrase.key, error.phrase.values);
  return wordsIn(useLanguage.getState().language, error instanceof Error ? error.message : String(error));
}
