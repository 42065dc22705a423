/** Which detections belong to the shown image: on a robot that turns, those of another one lie beside what they mark. */
import { stampOf } from "./detections";

/** Detections that are further from the image than this do not fit. */
export const FITS_MS = 500;
const KEPT_MS = 2000;

export interface Found {
  /** The detector's message. */
  text: string;
  receivedMs: number;
}

/** Add a message to those of the last seconds. A message of the past, as of a recording, replaces those after it. */
export function keepRecent(found: readonly Found[], added: Found): Found[] {
  return [...found.filter(({ receivedMs }) => receivedMs < added.receivedMs && receivedMs > added.receivedMs - KEPT_MS), added];
}

/** The shown image: when it was taken, s of ROS time, if that is known, and when it arrived. */
export interface ShownImage {
  stampS: number | null;
  receivedMs: number;
}

/**
 * The message to draw over an image: the one whose stamp is nearest to the image's. A message without detections has no
 * stamp, so that it is compared by its arrival. null where none fits.
 */
export function findFor(found: readonly Found[], image: ShownImage): string | null {
  let [best, leastMs]: [string | null, number] = [null, FITS_MS];
  for (const { text, receivedMs } of found) {
    const stampS = image.stampS === null ? null : stampOf(text);
    const apartMs = Math.abs(stampS === null || image.stampS === null ? receivedMs - image.receivedMs : (stampS - image.stampS) * 1000);
    if (apartMs <= leastMs) [best, leastMs] = [text, apartMs];
  }
  return best;
}
