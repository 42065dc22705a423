/** What this browser keeps. */

/** Null where a browser forbids it, as for pages of a sandbox. */
export function localStorageOrNull(): Storage | null {
  try {
    return window.localStorage;
  } catch {
    return null;
  }
}
