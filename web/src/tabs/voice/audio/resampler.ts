/** Resampling of a stream by a windowed sinc (Smith, Digital Audio Resampling, https://ccrma.stanford.edu/~jos/resample/). */

/** Zero crossings of the kernel on each side. */
const CROSSINGS = 8;
/** How many positions between two samples the kernel is computed for. */
const PHASES = 64;
/** The pass band, as a share of what the lower rate can hold: the rest is for the slope of the filter. */
const PASS = 0.92;

export class Resampler {
  private readonly step: number;
  private readonly reach: number;
  private readonly kernels: Float32Array[];
  private input: Float32Array;
  /** Where the next output sample lies in `input`. */
  private position: number;

  constructor(fromHz: number, toHz: number) {
    this.step = fromHz / toHz;
    const cutoff = PASS * Math.min(1, toHz / fromHz);
    this.reach = Math.ceil(CROSSINGS / cutoff);
    this.kernels = Array.from({ length: PHASES }, (_, phase) => kernel(cutoff, this.reach, phase / PHASES));
    this.input = new Float32Array(this.reach);
    this.position = this.reach;
  }

  /** The output for the next input: it lags by a millisecond or less. */
  take(samples: Float32Array): number[] {
    const input = new Float32Array(this.input.length + samples.length);
    input.set(this.input);
    input.set(samples, this.input.length);
    const output: number[] = [];
    while (this.position + this.reach + 1 < input.length) {
      const before = Math.floor(this.position);
      const weights = this.kernels[Math.floor((this.position - before) * PHASES)] ?? new Float32Array();
      let sum = 0;
      for (let tap = 0; tap < weights.length; tap += 1) sum += (weights[tap] ?? 0) * (input[before - this.reach + 1 + tap] ?? 0);
      output.push(sum);
      this.position += this.step;
    }
    const done = Math.max(0, Math.floor(this.position) - this.reach);
    this.input = input.slice(done);
    this.position -= done;
    return output;
  }
}

/** The weights of the samples around a point that lies `fraction` after one of them; they add up to 1. */
function kernel(cutoff: number, reach: number, fraction: number): Float32Array {
  const weights = Float32Array.from({ length: 2 * reach }, (_, tap) => {
    const x = tap - reach + 1 - fraction;
    const window = Math.abs(x) >= reach ? 0 : 0.5 * (1 + Math.cos((Math.PI * x) / reach));
    const phase = Math.PI * cutoff * x;
    return window * (phase === 0 ? 1 : Math.sin(phase) / phase);
  });
  const sum = weights.reduce((total, weight) => total + weight, 0);
  return weights.map((weight) => weight / sum);
}
