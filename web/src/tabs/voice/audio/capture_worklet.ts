/** The microphone's samples as frames of 50 ms at 16 kHz, computed in the thread of the sound. */
import { toInt16 } from "./pcm";
import { Resampler } from "./resampler";

declare const sampleRate: number;
declare class AudioWorkletProcessor {
  readonly port: MessagePort;
}
declare function registerProcessor(name: string, processor: typeof AudioWorkletProcessor): void;

const RATE_HZ = 16_000;
const FRAME_SAMPLES = 800;

class Capture extends AudioWorkletProcessor {
  private readonly resampler = new Resampler(sampleRate, RATE_HZ);
  private frame = new Int16Array(FRAME_SAMPLES);
  private filled = 0;

  process(inputs: Float32Array[][]): boolean {
    const channel = inputs[0]?.[0];
    if (channel === undefined) return true; // the microphone is muted or gone
    for (const sample of this.resampler.take(channel)) {
      this.frame[this.filled] = toInt16(sample);
      this.filled += 1;
      if (this.filled < FRAME_SAMPLES) continue;
      this.port.postMessage(this.frame, [this.frame.buffer]);
      this.frame = new Int16Array(FRAME_SAMPLES);
      this.filled = 0;
    }
    return true;
  }
}

registerProcessor("capture", Capture);
