/** Rewinding the page: from live to a moment of the run's recording, along it, and back. */
import { useConsole } from "@/api/console_store";
import { getJson } from "@/api/http";
import { TOPICS } from "@/generated/graph";
import { errorText } from "@/i18n/error_text";
import { textIn, useLanguage } from "@/i18n/text";
import { liveMap } from "@/map/live_map";
import { dropDraft } from "@/map/map_ui";
import { driver } from "@/robot/driving";
import { robotTime } from "@/robot/link";
import { useGate } from "@/robot/stop";
import { TopicStore } from "@/ros/topics";
import { useRoute } from "@/state/route";
import type { TabId } from "@/state/tab_ids";
import { RecordedSource } from "./recorded_source";
import { LIVE, isRewound, useRewind } from "@/state/rewind";
import { setClockOffset, toPageMs } from "@/hooks/view_clock";
import { type Load, Windows, loadFrom } from "./windows";

/** How far back it goes. */
export const REACH_S = 5 * 60;
/** Where rewinding begins, before the end of the recording. */
const BEGIN_S = 10;
const PLAY_PERIOD_MS = 100;
/** While the page is rewound, the recording grows: its end is asked for this often. */
const EXTENT_PERIOD_MS = 2000;

let windows: Windows | null = null;
let load: Load | null = null;
let opening: AbortController | null = null;
let timers: ReturnType<typeof setInterval>[] = [];

const source = new RecordedSource(
  new Set([TOPICS.TF.name, TOPICS.TF_STATIC.name]),
  () => {
    recordedTopics.clear();
    liveMap.forget();
  },
  // Views subscribe one after the other: what they lack is loaded once.
  () => setTimeout(() => void show(), 0),
);

/** The samples of the shown moment, with the times of their arrival on the page's clock. */
export const recordedTopics = new TopicStore(source, () => toPageMs(source.deliveringS));

/** Rewind by some seconds; live pages begin at the end of what was recorded. */
export async function rewind(): Promise<void> {
  if (isRewound() || opening !== null) return;
  opening = new AbortController();
  const { signal } = opening;
  try {
    const begun = loadFrom(await currentRun());
    const { startS, endS } = await begun(null, signal);
    if (signal.aborted) return;
    if (endS <= startS) throw new Error(textIn(useLanguage.getState().language, "rewind_nothing_recorded"));
    // Meanwhile another view may have been opened.
    if (!hasPast(useRoute.getState().tab)) return;
    load = begun;
    windows = new Windows(begun);
    const nowMs = performance.now();
    setClockOffset((robotTime(nowMs) ?? endS) - nowMs / 1000);
    driver.letGo();
    dropDraft();
    liveMap.setAside();
    useRewind.setState({ ...LIVE, extent: { startS: Math.max(startS, endS - REACH_S), endS }, shownS: Math.max(startS, endS - BEGIN_S) });
    timers = [setInterval(step, PLAY_PERIOD_MS), setInterval(() => void updateExtent(), EXTENT_PERIOD_MS)];
  } catch (error) {
    if (!signal.aborted) throw error;
  } finally {
    if (opening?.signal === signal) opening = null;
  }
}

/** The id of the run whose graph this is. Of `lupin console`, which belongs to no run, it is the one that is up. */
export async function currentRun(): Promise<string> {
  const { id } = useConsole.getState().run;
  if (id !== undefined && id !== "") return id;
  const up = (await getJson<{ id: string; state: string }[]>("/_api/runs")).find(({ state }) => state === "up");
  if (up === undefined) throw new Error(textIn(useLanguage.getState().language, "rewind_no_run"));
  return up.id;
}

/** Back to live; what is still loading does not rewind any more. */
export function goLive(): void {
  opening?.abort();
  opening = null;
  if (!isRewound()) return;
  for (const timer of timers) clearInterval(timer);
  windows = load = null;
  source.close();
  recordedTopics.clear();
  useRewind.setState(LIVE);
  liveMap.takeUp();
}

/** Show another moment, within the recording. */
export function showAt(atS: number): void {
  const { extent } = useRewind.getState();
  if (!isRewound() || extent === null) return;
  useRewind.setState({ shownS: Math.min(extent.endS, Math.max(extent.startS, atS)) });
  void show();
}

export function setPlaying(isPlaying: boolean): void {
  if (isRewound()) useRewind.setState({ isPlaying });
}

/** Deliver the samples of the shown moment; they are loaded where they are not here yet. */
async function show(): Promise<void> {
  const { shownS } = useRewind.getState();
  const { topics } = source;
  if (shownS === null || windows === null || topics.length === 0) return;
  const known = windows.find(shownS, topics);
  if (known !== undefined) {
    source.show(known, shownS);
    // Whatever follows the clock looks again at what was delivered.
    useRewind.setState({ isLoading: false, problem: "" });
    return;
  }
  if (opening !== null) return; // its end looks again at what is to be shown
  const from = windows;
  opening = new AbortController();
  const { signal } = opening;
  useRewind.setState({ isLoading: true });
  try {
    await from.open(shownS, topics, signal);
    if (signal.aborted) return;
    opening = null;
    await show();
  } catch (error) {
    if (signal.aborted) return;
    opening = null;
    useRewind.setState({ isLoading: false, isPlaying: false, problem: errorText(error) });
  }
}

function step(): void {
  const { isPlaying, isLoading, shownS, extent } = useRewind.getState();
  if (!isPlaying || isLoading || shownS === null || extent === null) return;
  showAt(shownS + PLAY_PERIOD_MS / 1000);
  if (shownS + PLAY_PERIOD_MS / 1000 >= extent.endS) setPlaying(false);
}

async function updateExtent(): Promise<void> {
  const asked = load;
  if (asked === null) return;
  try {
    const { startS, endS } = await asked(null, AbortSignal.timeout(EXTENT_PERIOD_MS));
    const { shownS, extent } = useRewind.getState();
    if (asked !== load || shownS === null || extent === null) return;
    // The shown moment stays within reach, however long somebody looks at it.
    useRewind.setState({ extent: { startS: Math.min(shownS, Math.max(startS, endS - REACH_S)), endS } });
  } catch {
    // The recording is shown as far as it is known.
  }
}

/** What ends it: a view that has no past, and a press of the stop: what counts then is what the robot does now. */
export function followPage(): void {
  useRoute.subscribe(({ tab }) => hasPast(tab) || goLive());
  useGate.subscribe((gate, before) => gate.presses !== before.presses && goLive());
}

export function hasPast(tab: TabId): boolean {
  return tab === "map" || tab === "cameras";
}
