/** A sound file like speech: syllables of a voice, then silence. What browsers take for noise they would filter out. */
import { writeFileSync } from "node:fs";

const RATE_HZ = 48_000;
const PITCH_HZ = 130;
const SYLLABLE_S = 0.22;

/** Write a WAV file of mono PCM-16, which a browser's fake microphone plays again and again. */
export function writeSpeech(path: string, speechS: number, silenceS: number): void {
  const count = Math.round(RATE_HZ * (speechS + silenceS));
  const data = Buffer.alloc(2 * count);
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
    data.writeInt16LE(Math.round(Math.max(-1, Math.min(1, 0.25 * loudness * sample)) * 32_000), 2 * index);
  }
  const header = Buffer.alloc(44);
  header.write("RIFF", 0);
  header.writeUInt32LE(36 + data.length, 4);
  header.write("WAVEfmt ", 8);
  header.writeUInt32LE(16, 16);
  header.writeUInt16LE(1, 20);
  header.writeUInt16LE(1, 22);
  header.writeUInt32LE(RATE_HZ, 24);
  header.writeUInt32LE(2 * RATE_HZ, 28);
  header.writeUInt16LE(2, 32);
  header.writeUInt16LE(16, 34);
  header.write("data", 36);
  header.writeUInt32LE(data.length, 40);
  writeFileSync(path, Buffer.concat([header, data]));
}
