import { describe, expect, it, vi } from "vitest";
import { Endpointer } from "./endpointer";
import { fromBase64, fromPcm, loudness, toBase64, toInt16 } from "./pcm";
import { Player } from "./player";
import { Resampler } from "./resampler";

describe("PCM", () => {
  it("survives base64", () => {
    const samples = Int16Array.from([0, 1, -1, 32_767, -32_768, 1234]);
    expect([...fromBase64(toBase64(samples))].map(toInt16)).toEqual([...samples]);
    expect(fromBase64(toBase64(new Int16Array(20_000)))).toHaveLength(20_000);
  });

  it("comes as bytes, too", () => {
    expect([...fromPcm(Int16Array.from([0, 16_384, -32_768]).buffer)]).toEqual([0, 0.5, -1]);
    expect(fromPcm(new ArrayBuffer(3))).toHaveLength(1);
  });

  it("that is damaged is silent", () => {
    expect(fromBase64("%%")).toHaveLength(0);
    expect(fromBase64("AAA=")).toHaveLength(1);
  });

  it("has a loudness from 0 to 1", () => {
    expect(loudness(new Int16Array(0))).toBe(0);
    expect(loudness(Int16Array.from({ length: 800 }, (_, index) => 16_384 * Math.sin(index / 5)))).toBeCloseTo(0.354, 2);
  });
});

describe("the resampler", () => {
  function resampled(fromHz: number, toneHz: number): number[] {
    const resampler = new Resampler(fromHz, 16_000);
    const output: number[] = [];
    for (let block = 0; block < 375; block += 1) {
      output.push(...resampler.take(Float32Array.from({ length: 128 }, (_, index) => Math.sin((2 * Math.PI * toneHz * (block * 128 + index)) / fromHz))));
    }
    return output;
  }
  const amplitude = (samples: readonly number[]) => Math.max(...samples.slice(500, 4000).map(Math.abs));

  it.each([48_000, 44_100, 16_000, 8000])("keeps a voice from %d Hz", (fromHz) => {
    const output = resampled(fromHz, 440);
    expect(output.length / ((375 * 128 * 16_000) / fromHz)).toBeCloseTo(1, 2);
    expect(amplitude(output)).toBeCloseTo(1, 1);
  });

  it("drops what 16 kHz cannot hold", () => {
    expect(amplitude(resampled(48_000, 11_000))).toBeLessThan(0.02);
  });
});

describe("the endpointer", () => {
  const rules = { startThreshold: 0.02, endThreshold: 0.012, endHoldMs: 800, maxUtteranceMs: 15_000 };
  const frames = (endpointer: Endpointer, level: number, count: number) => Array.from({ length: count }, () => endpointer.take(level, 50)).filter((each) => each !== null);

  it("begins at speech, and ends after silence", () => {
    const endpointer = new Endpointer(() => rules);
    expect(frames(endpointer, 0.005, 20)).toEqual([]);
    expect(frames(endpointer, 0.05, 10)).toEqual(["begin"]);
    expect(frames(endpointer, 0.005, 15)).toEqual([]);
    expect(frames(endpointer, 0.005, 1)).toEqual(["end"]);
  });

  it("takes no click for speech, and no pause for its end", () => {
    const endpointer = new Endpointer(() => rules);
    expect(frames(endpointer, 0.5, 1)).toEqual([]);
    expect(frames(endpointer, 0.005, 5)).toEqual([]);
    expect(frames(endpointer, 0.05, 4)).toEqual(["begin"]);
    expect([...frames(endpointer, 0.005, 10), ...frames(endpointer, 0.015, 1), ...frames(endpointer, 0.005, 10)]).toEqual([]);
  });

  it("ends the longest utterance, and waits for silence then", () => {
    const endpointer = new Endpointer(() => rules);
    expect(frames(endpointer, 0.05, 310)).toEqual(["begin", "end"]);
    expect(frames(endpointer, 0.05, 100)).toEqual([]);
    frames(endpointer, 0.005, 16);
    expect(frames(endpointer, 0.05, 4)).toEqual(["begin"]);
  });

  it("follows the settings, also where silence is set louder than speech", () => {
    const endpointer = new Endpointer(() => ({ ...rules, endThreshold: 0.5 }));
    expect(frames(endpointer, 0.05, 40)).toEqual(["begin"]);
    expect(frames(endpointer, 0.001, 16)).toEqual(["end"]);
  });
});

describe("the player", () => {
  function created() {
    const sources: { start: ReturnType<typeof vi.fn>; stop: ReturnType<typeof vi.fn>; onended: (() => void) | null }[] = [];
    const context = {
      currentTime: 10,
      destination: {},
      createBuffer: (_: number, length: number, rateHz: number) => ({ copyToChannel: () => {}, duration: length / rateHz }),
      createBufferSource: () => {
        const source = { buffer: null, connect: vi.fn(), start: vi.fn(), stop: vi.fn(), disconnect: vi.fn(), onended: null };
        sources.push(source);
        return source;
      },
    };
    const changed = vi.fn();
    return { context, sources, changed, player: new Player(context as never, changed) };
  }
  const second = new Float32Array(24_000);

  it("plays chunks one after the other", () => {
    const { sources, player, changed } = created();
    player.play(second, 24_000);
    player.play(second, 24_000);
    expect(sources.map(({ start }) => start.mock.calls[0]?.[0] as number)).toEqual([10.06, 11.06]);
    expect(changed.mock.calls).toEqual([[true]]);
    for (const source of sources) source.onended?.();
    expect(changed.mock.calls).toEqual([[true], [false]]);
  });

  it("falls silent at once, and begins at once afterwards", () => {
    const { sources, player, changed } = created();
    player.play(second, 24_000);
    player.play(second, 24_000);
    player.flush();
    expect(sources.every(({ stop }) => stop.mock.calls.length === 1)).toBe(true);
    expect(player.isPlaying).toBe(false);
    expect(changed).toHaveBeenLastCalledWith(false);
    player.play(second, 24_000);
    expect(sources[2]?.start).toHaveBeenCalledWith(10.06);
  });

  it("takes no more than some minutes", () => {
    const { sources, player } = created();
    for (let chunk = 0; chunk < 400; chunk += 1) player.play(second, 24_000);
    expect(sources.length).toBeLessThan(190);
  });
});
