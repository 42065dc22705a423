// @vitest-environment jsdom
import { beforeEach, describe, expect, it, vi } from "vitest";
import type { RecordedSample } from "@/rewind/windows";
import type { PlotSeries } from "./plot_store";

const live = vi.hoisted(() => ({ listeners: [] as (() => void)[], sample: undefined as { message: unknown; receivedMs: number } | undefined }));

vi.mock("@/robot/link", () => ({
  topics: {
    listen: (_: unknown, __: unknown, listener: () => void) => {
      live.listeners.push(listener);
      return () => live.listeners.splice(live.listeners.indexOf(listener), 1);
    },
    last: () => live.sample,
  },
}));
vi.mock("./past", () => ({ readRunPast: vi.fn(), travelTimeS: () => 0.25 }));

const { PlotRecorder } = await import("./recorder");

const series = (topic: string, id = topic): PlotSeries => ({ id, style: 0, topic, type: "std_msgs/msg/Float64", path: "data" }) as PlotSeries;
const past = (topic: string, atS: number, data: number): RecordedSample => ({ topic, atS, message: { data } });

function receive(atS: number, data: number): void {
  live.sample = { message: { data }, receivedMs: atS * 1000 };
  for (const listener of [...live.listeners]) listener();
}

const listed = (samples: { size: number; timeAt: (index: number) => number; valueAt: (index: number) => number } | null) =>
  Array.from({ length: samples?.size ?? 0 }, (_, index) => [samples?.timeAt(index), samples?.valueAt(index)]);

beforeEach(() => {
  live.listeners.length = 0;
  vi.spyOn(performance, "now").mockReturnValue(100_000);
});

describe("a plot's samples", () => {
  it("are filled back up to the first live one, each topic for itself", async () => {
    const asked: (readonly string[])[] = [];
    let take: (samples: RecordedSample[]) => void = () => {};
    const recorder = new PlotRecorder((topics, _reach, found) => {
      asked.push(topics);
      take = found;
      return Promise.resolve();
    });
    recorder.record([series("/a"), series("/b")]);
    receive(100.5, 7);
    // The sample of 100.4 came live as that of 100.5; of /b, nothing came yet.
    take([past("/a", 98, 1), past("/a", 99, 2), past("/a", 100.4, 7), past("/b", 97, 5)]);
    take([past("/a", 40, 0)]);
    await Promise.resolve();
    expect(asked).toEqual([["/a", "/b"]]);
    expect(listed(recorder.samples("/a"))).toEqual([[40, 0], [98, 1], [99, 2], [100.5, 7]]);
    expect(listed(recorder.samples("/b")).slice(0, 1)).toEqual([[97, 5]]);
  });

  it("of a series that was added later are read for that one alone", () => {
    const asked: (readonly string[])[] = [];
    const recorder = new PlotRecorder((topics) => {
      asked.push(topics);
      return Promise.resolve();
    });
    recorder.record([series("/a")]);
    recorder.record([series("/a"), series("/b")]);
    recorder.record([series("/b")]);
    expect(asked).toEqual([["/a"], ["/b"]]);
    expect(recorder.samples("/a")).toBeNull();
    expect(live.listeners.length).toBe(1);
  });

  it("are read no further once the plots are closed", () => {
    let signal: AbortSignal | undefined;
    const recorder = new PlotRecorder((_topics, _reach, _take, aborted) => {
      signal = aborted;
      return new Promise(() => {});
    });
    recorder.record([series("/a")]);
    recorder.stop();
    expect([signal?.aborted, live.listeners.length]).toEqual([true, 0]);
  });
});
