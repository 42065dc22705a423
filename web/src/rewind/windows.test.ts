// @vitest-environment jsdom
import { encode } from "cbor2";
import { describe, expect, it } from "vitest";
import { type Answer, LEAD_S, MalformedWindow, WINDOW_S, Windows, parseAnswer } from "./windows";

const bytes = (...items: unknown[]) => new Uint8Array(items.flatMap((item) => [...encode(item)]));
const HEAD = { start_s: 5, end_s: 95.5, complete_s: 20 };

describe("an answer with a window", () => {
  it("has the recording's times and the samples", () => {
    const answer = parseAnswer(bytes(HEAD, ["/scan", 12.5, { ranges: Float32Array.from([1, NaN]) }], ["/map", 3, null]));
    expect([answer.startS, answer.endS, answer.completeS]).toEqual([5, 95.5, 20]);
    expect(answer.samples.map(({ topic, atS }) => [topic, atS])).toEqual([
      ["/scan", 12.5],
      ["/map", 3],
    ]);
    expect(answer.samples[0]?.message).toEqual({ ranges: Float32Array.from([1, NaN]) });
  });

  it("is refused where it is cut or something else", () => {
    const whole = bytes(HEAD, ["/scan", 12.5, { data: "text" }]);
    for (const damaged of [new Uint8Array(), bytes({ start_s: 1 }), bytes(7), bytes(HEAD, 7), whole.slice(0, -3), new TextEncoder().encode("<html>")]) {
      expect(() => parseAnswer(damaged)).toThrow(MalformedWindow);
    }
  });
});

/** A recording with one sample a second, whose windows are cut after `limit` samples. */
function recording(endS: number, limit = Infinity) {
  const asked: [number, number, readonly string[]][] = [];
  const load = async (query: { fromS: number; toS: number; topics: readonly string[] } | null): Promise<Answer> => {
    if (query === null) return { startS: 0, endS, completeS: 0, samples: [] };
    asked.push([query.fromS, query.toS, query.topics]);
    const all = Array.from({ length: Math.floor(endS) + 1 }, (_, atS) => ({ topic: "/tf", atS, message: atS })).filter(({ atS }) => atS >= query.fromS && atS <= query.toS);
    const samples = all.slice(0, limit);
    const cutS = all[samples.length]?.atS;
    return { startS: 0, endS, completeS: cutS === undefined ? Math.min(query.toS, endS) : cutS - 0.001, samples };
  };
  return { asked, load };
}

const NEVER = new AbortController().signal;

describe("the windows of a recording", () => {
  it("begin earlier than they are shown, and are found again", async () => {
    const { asked, load } = recording(100);
    const windows = new Windows(load);
    const opened = await windows.open(23, ["/tf"], NEVER);
    expect(asked).toEqual([[2 * WINDOW_S - LEAD_S, 3 * WINDOW_S, ["/tf"]]]);
    expect(windows.find(29.9, ["/tf"])).toBe(opened);
    expect(windows.find(19.9, ["/tf"])).toBeUndefined();
    expect(windows.find(23, ["/tf", "/map"])).toBeUndefined();
  });

  it("are loaded anew where the recording has grown", async () => {
    const { load } = recording(23);
    const windows = new Windows(load);
    await windows.open(22, ["/tf"], NEVER);
    expect(windows.find(23, ["/tf"])).toBeDefined();
    expect(windows.find(23.5, ["/tf"])).toBeUndefined();
  });

  it("go on where the server cut one", async () => {
    const { asked, load } = recording(100, 4);
    const window = await new Windows(load).open(28, ["/tf"], NEVER);
    expect(asked.length).toBeGreaterThan(1);
    expect(window.samples.some(({ atS }) => atS === 28)).toBe(true);
    expect(window.fromS).toBeLessThanOrEqual(28);
  });

  it("do not load for ever where nothing comes", async () => {
    const { asked, load } = recording(100, 0);
    const window = await new Windows(load).open(28, ["/tf"], NEVER);
    expect(asked.length).toBeLessThanOrEqual(6);
    expect(window.completeS).toBeGreaterThanOrEqual(28);
  });
});
