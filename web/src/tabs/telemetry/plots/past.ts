/**
 * What a plot would show if it had been open earlier: the samples of the run's recording.
 *
 * The recorder writes every few seconds. So the past is read once the recording has reached the moment at which the plot began:
 * nothing is missing in between. It is read backwards, the latest seconds first.
 */
import { currentRun } from "@/rewind/rewind";
import { type Load, type RecordedSample, loadFrom } from "@/rewind/windows";
import { robotTime, useLink } from "@/robot/link";

/** The server answers windows of up to 30 s, and cuts those with too many samples. */
const WINDOW_S = 30;
const MAX_PARTS = 6;
const POLL_MS = 1000;
const MAX_POLLS = 8;

export interface PastQuery {
  topics: readonly string[];
  /** When the plot began, s of performance.now(). */
  begunS: number;
  /** How far back it reaches. */
  reachS: number;
  /** The robot's clock minus performance.now(), s. */
  offsetS: number;
}

/** Read the past, and hand over what was found of each window, the latest window first, with times of performance.now(). */
export async function readPast(load: Load, { topics, begunS, reachS, offsetS }: PastQuery, take: (samples: RecordedSample[]) => void, signal: AbortSignal): Promise<void> {
  const endS = begunS + offsetS;
  let extent = await load(null, signal);
  for (let poll = 0; poll < MAX_POLLS && extent.endS < endS; poll += 1) {
    await new Promise((done) => setTimeout(done, POLL_MS));
    if (signal.aborted) return;
    extent = await load(null, signal);
  }
  const firstS = Math.max(extent.startS, endS - reachS);
  for (let toS = Math.min(endS, extent.endS); toS > firstS; toS -= WINDOW_S) {
    const fromS = Math.max(firstS, toS - WINDOW_S, 0);
    const samples: RecordedSample[] = [];
    let beginS = fromS;
    for (let part = 0; part < MAX_PARTS; part += 1) {
      const answer = await load({ fromS: beginS, toS, topics }, signal);
      if (signal.aborted) return;
      // The last sample before the window belongs to the window before it.
      samples.push(...answer.samples.filter(({ atS }) => atS > beginS && atS <= toS));
      if (answer.completeS >= toS || answer.completeS <= beginS) break;
      beginS = answer.completeS;
    }
    take(samples.map((sample) => ({ ...sample, atS: sample.atS - offsetS })));
  }
}

/** Read the past of this run. Where there is none, such as without a recording, plots begin with the page. */
export async function readRunPast(topics: readonly string[], reachS: number, take: (samples: RecordedSample[]) => void, signal: AbortSignal): Promise<void> {
  const begunS = performance.now() / 1000;
  const robotS = robotTime(begunS * 1000);
  if (robotS === null) return;
  try {
    await readPast(loadFrom(await currentRun()), { topics, begunS, reachS, offsetS: robotS - begunS }, take, signal);
  } catch {
    // Not recorded, or out of reach now.
  }
}

/** How much earlier than it arrives here a sample is recorded at most, s. */
export function travelTimeS(): number {
  return (useLink.getState().roundTripMs ?? 0) / 1000;
}
