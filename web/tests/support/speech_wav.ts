/** Sound files of speech, for a browser's fake microphone: it plays a file again and again, or once if `%noloop` follows its name. */
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";

const RATE_HZ = 48_000;
const PITCH_HZ = 130;
const SYLLABLE_S = 0.22;
const HEADER_BYTES = 44;

/** The rate of espeak-ng, and its voice that recognizers understand best. */
const ESPEAK_RATE_HZ = 22_050;
const VOICE = ["-v", "en-gb", "-s", "145"];
/** The mean loudness of speech, of the full scale. */
const SPEECH_LEVEL = 0.1;

/** Write a file of syllables of a voice, then silence. What browsers take for noise they would filter out. */
export function writeSpeech(file: string, speechS: number, silenceS: number): void {
  const samples = new Float32Array(Math.round(RATE_HZ * (speechS + silenceS)));
  for (let index = 0; index < RATE_HZ * speechS; index += 1) {
    const timeS = index / RATE_HZ;
    const syllable = Math.floor(timeS / SYLLABLE_S);
    const loudness = Math.sin((Math.PI * (timeS % SYLLABLE_S)) / SYLLABLE_S) ** 2;
    const pitch = PITCH_HZ * (1 + 0.1 * Math.sin(syllable * 2.1));
    let sample = 0;
    // The harmonics near two formants, which differ by syllable.
    for (let harmonic = 1; harmonic <= 24; harmonic += 1) {
      const hz = harmonic * pitch;
      const weight = Math.exp(-(((hz - 500 - 150 * (syllable % 3)) / 250) ** 2)) + 0.5 * Math.exp(-(((hz - 1500 + 200 * (syllable % 2)) / 300) ** 2));
      sample += weight * Math.sin(2 * Math.PI * hz * timeS);
    }
    samples[index] = 0.25 * loudness * sample;
  }
  writeWav(file, samples, RATE_HZ);
}

export interface Sentence {
  text: string;
  /** Silence after it, s. */
  pauseS: number;
}

/** When each sentence begins and ends, s from the begin of its file. */
export interface Spoken {
  text: string;
  beginS: number;
  endS: number;
}

/** Whether sentences can be spoken on this computer. */
export function canSpeak(): boolean {
  return spawnSync("espeak-ng", ["--version"]).status === 0;
}

/** Write a file of sentences that espeak-ng speaks, after a silence. */
export function writeSentences(file: string, leadS: number, sentences: readonly Sentence[]): Spoken[] {
  const parts = sentences.map(({ text, pauseS }) => ({ text, pauseS, samples: speak(text) }));
  const count = parts.reduce((sum, { pauseS, samples }) => sum + samples.length + pauseS * ESPEAK_RATE_HZ, leadS * ESPEAK_RATE_HZ);
  const all = new Float32Array(Math.ceil(count));
  let position = Math.round(leadS * ESPEAK_RATE_HZ);
  const spoken = parts.map(({ text, pauseS, samples }) => {
    const beginS = position / ESPEAK_RATE_HZ;
    all.set(samples, position);
    position += samples.length;
    const endS = position / ESPEAK_RATE_HZ;
    position += Math.round(pauseS * ESPEAK_RATE_HZ);
    return { text, beginS, endS };
  });
  writeWav(file, all, ESPEAK_RATE_HZ);
  return spoken;
}

/** A sentence without the silence around it, at the loudness of speech. */
function speak(text: string): Float32Array {
  const folder = mkdtempSync(path.join(tmpdir(), "lupin-speech-"));
  try {
    const file = path.join(folder, "sentence.wav");
    const done = spawnSync("espeak-ng", [...VOICE, "-w", file, text], { timeout: 20_000 });
    if (done.status !== 0) throw new Error(`espeak-ng failed: ${done.stderr.toString()}`);
    const wav = readFileSync(file);
    if (wav.readUInt32LE(24) !== ESPEAK_RATE_HZ) throw new Error(`espeak-ng speaks at ${wav.readUInt32LE(24)} Hz`);
    const samples = Float32Array.from({ length: (wav.length - HEADER_BYTES) / 2 }, (_, index) => wav.readInt16LE(HEADER_BYTES + 2 * index) / 32_768);
    const isLoud = (sample: number) => Math.abs(sample) > 0.01;
    const heard = samples.subarray(samples.findIndex(isLoud), samples.findLastIndex(isLoud) + 1);
    const gain = SPEECH_LEVEL / Math.sqrt(heard.reduce((sum, sample) => sum + sample * sample, 0) / heard.length);
    return heard.map((sample) => gain * sample);
  } finally {
    rmSync(folder, { recursive: true });
  }
}

/** Write samples from -1 to 1 as mono PCM-16. */
function writeWav(file: string, samples: Float32Array, rateHz: number): void {
  const data = Buffer.alloc(2 * samples.length);
  for (const [index, sample] of samples.entries()) data.writeInt16LE(Math.round(Math.max(-1, Math.min(1, sample)) * 32_000), 2 * index);
  const header = Buffer.alloc(HEADER_BYTES);
  header.write("RIFF", 0);
  header.writeUInt32LE(36 + data.length, 4);
  header.write("WAVEfmt ", 8);
  header.writeUInt32LE(16, 16);
  header.writeUInt16LE(1, 20);
  header.writeUInt16LE(1, 22);
  header.writeUInt32LE(rateHz, 24);
  header.writeUInt32LE(2 * rateHz, 28);
  header.writeUInt16LE(2, 32);
  header.writeUInt16LE(16, 34);
  header.write("data", 36);
  header.writeUInt32LE(data.length, 40);
  writeFileSync(file, Buffer.concat([header, data]));
}
