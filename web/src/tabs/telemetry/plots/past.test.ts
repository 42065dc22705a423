// @vitest-environment jsdom
import { expect, it, vi } from "vitest";
import type { Load, RecordedSample } from "@/rewind/windows";

vi.mock("@/robot/link", () => ({ robotTime: () => null, useLink: { getState: () => ({ roundTripMs: null }) } }));
vi.mock("@/rewind/rewind", () => ({ currentRun: () => Promise.reject(new Error("no run")) }));
const { readPast, readRunPast } = await import("./past");

const query = { topics: ["/odom"], begunS: 100, reachS: 300, offsetS: 1000 };

/** A recording with a sample each second, which grows by some seconds whenever its extent is asked for. */
function recording(startS: number, ends: number[], longestS = Infinity): { load: Load; windows: [number, number][] } {
  const windows: [number, number][] = [];
  let endS = startS;
  const load: Load = (asked) => {
    if (asked === null) {
      endS = ends.shift() ?? endS;
      return Promise.resolve({ startS, endS, completeS: endS, samples: [] });
    }
    windows.push([asked.fromS, asked.toS]);
    const completeS = Math.min(asked.toS, asked.fromS + longestS);
    const samples: RecordedSample[] = [];
    for (let atS = Math.max(startS, Math.floor(asked.fromS) - 1); atS <= completeS; atS += 1) samples.push({ topic: "/odom", atS, message: {} });
    return Promise.resolve({ startS, endS, completeS, samples });
  };
  return { load, windows };
}

async function times(load: Load, signal = new AbortController().signal): Promise<number[][]> {
  const taken: number[][] = [];
  await readPast(load, query, (samples) => taken.push(samples.map(({ atS }) => atS)), signal);
  return taken;
}

it("is read backwards, each sample once, with the page's times", async () => {
  const taken = await times(recording(1000, [1105]).load);
  expect(taken).toHaveLength(4);
  expect(taken[0]?.at(-1)).toBe(100);
  expect(taken.toReversed().flat()).toEqual(Array.from({ length: 100 }, (_, index) => index + 1));
});

it("waits until the recording has reached the beginning of the plot", async () => {
  vi.useFakeTimers();
  const { load, windows } = recording(1050, [1090, 1095, 1101]);
  const taken = times(load);
  await vi.advanceTimersByTimeAsync(2500);
  expect((await taken).flat().toSorted((a, b) => a - b)).toEqual(Array.from({ length: 50 }, (_, index) => index + 51));
  expect(windows[0]).toEqual([1070, 1100]);
  vi.useRealTimers();
});

it("asks on where the server has cut a window", async () => {
  const taken = await times(recording(1080, [1105], 8).load);
  expect(taken.flat()).toEqual(Array.from({ length: 20 }, (_, index) => index + 81));
});

it("reaches as far back as the plot does, and ends when nobody looks", async () => {
  const long = recording(0, [1105]);
  expect((await times(long.load)).flat()).toHaveLength(300);
  const ended = new AbortController();
  ended.abort();
  expect(await times(recording(1000, [1105]).load, ended.signal)).toEqual([]);
});

it("leaves plots as they are where nothing was recorded", async () => {
  const take = vi.fn<() => void>();
  await readRunPast(["/odom"], 300, take, new AbortController().signal);
  expect(take).not.toHaveBeenCalled();
});
