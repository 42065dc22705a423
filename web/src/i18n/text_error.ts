import type { TextKey, TextValues } from "./text";

/** A text of the catalog. */
export interface Phrase {
  key: TextKey;
  values?: TextValues;
}

/**
 * An error in the words of the robot or the server, or with a text of the catalog. This module imports no catalog, so that
 * everything can throw it.
 */
export class WordedError extends Error {
  /** Null where the words come from elsewhere. */
  readonly phrase: Phrase | null;

  constructor(words: string | Phrase) {
    super(typeof words === "string" ? words : words.key);
    this.phrase = typeof words === "string" ? null : words;
  }
}

/** An error whose text is in the catalog. */
export class TextError extends WordedError {
  constructor(key: TextKey, values: TextValues = {}) {
    super({ key, values });
  }
}
