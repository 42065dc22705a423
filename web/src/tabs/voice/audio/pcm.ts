/** Sound as PCM of 16 bits: its base64 as messages carry it, its loudness, and another sampling rate. */

const FULL_SCALE = 32_768;
/** String.fromCharCode takes its characters as arguments, of which engines allow some ten thousand. */
const CHARACTERS_AT_ONCE = 8192;

export function toBase64(samples: Int16Array): string {
  const bytes = new Uint8Array(samples.buffer, samples.byteOffset, samples.byteLength);
  let text = "";
  for (let start = 0; start < bytes.length; start += CHARACTERS_AT_ONCE) text += String.fromCharCode(...bytes.subarray(start, start + CHARACTERS_AT_ONCE));
  return btoa(text);
}

/** Samples from -1 to 1; none where the text is not base64. Half a sample at the end is dropped. */
export function fromBase64(base64: string): Float32Array<ArrayBuffer> {
  let text: string;
  try {
    text = atob(base64);
  } catch {
    return new Float32Array(0);
  }
  const samples = new Float32Array(text.length >> 1);
  for (let index = 0; index < samples.length; index += 1) {
    const value = text.charCodeAt(2 * index) | (text.charCodeAt(2 * index + 1) << 8);
    samples[index] = (value >= FULL_SCALE ? value - 2 * FULL_SCALE : value) / FULL_SCALE;
  }
  return samples;
}

/** Samples from -1 to 1 of little-endian PCM of 16 bits. Half a sample at the end is dropped. */
export function fromPcm(bytes: ArrayBuffer): Float32Array<ArrayBuffer> {
  const view = new DataView(bytes);
  return Float32Array.from({ length: bytes.byteLength >> 1 }, (_, index) => view.getInt16(2 * index, true) / FULL_SCALE);
}

/** The root mean square, 0 to 1. */
export function loudness(samples: Int16Array): number {
  if (samples.length === 0) return 0;
  let sum = 0;
  for (const sample of samples) sum += sample * sample;
  return Math.sqrt(sum / samples.length) / FULL_SCALE;
}

export function toInt16(sample: number): number {
  return Math.max(-FULL_SCALE, Math.min(FULL_SCALE - 1, Math.round(sample * FULL_SCALE)));
}
