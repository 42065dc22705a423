/** Plays the chunks of the model's voice without gaps, and falls silent at once. */

type Source = Pick<AudioBufferSourceNode, "buffer" | "connect" | "start" | "stop" | "disconnect"> & { onended: unknown };

/** What the player uses of an AudioContext. */
export interface PlayerContext {
  readonly currentTime: number;
  readonly destination: unknown;
  createBuffer(channels: number, length: number, rateHz: number): { copyToChannel(samples: Float32Array<ArrayBuffer>, channel: number): void; readonly duration: number };
  createBufferSource(): Source;
}

/** Chunks come in bursts over the network: the first one waits for the next. */
const LEAD_S = 0.06;
/** A model that is ahead of its own voice by more than this sends without end. */
const MAX_AHEAD_S = 180;

export class Player {
  private readonly sources = new Set<Source>();
  private nextS = 0;

  /** `changed` is called when it begins to play and when nothing is left. */
  constructor(
    private readonly context: PlayerContext,
    private readonly changed: (isPlaying: boolean) => void,
  ) {}

  get isPlaying(): boolean {
    return this.sources.size > 0;
  }

  /** Append samples from -1 to 1. */
  play(samples: Float32Array<ArrayBuffer>, rateHz: number): void {
    const nowS = this.context.currentTime;
    if (samples.length === 0 || this.nextS - nowS > MAX_AHEAD_S) return;
    const buffer = this.context.createBuffer(1, samples.length, rateHz);
    buffer.copyToChannel(samples, 0);
    const source = this.context.createBufferSource();
    source.buffer = buffer as AudioBuffer;
    source.connect(this.context.destination as AudioNode);
    source.onended = () => this.remove(source);
    const startS = this.nextS > nowS ? this.nextS : nowS + LEAD_S;
    source.start(startS);
    this.nextS = startS + buffer.duration;
    this.sources.add(source);
    if (this.sources.size === 1) this.changed(true);
  }

  /** Drop everything that is left to play. */
  flush(): void {
    this.nextS = 0;
    for (const source of this.sources) {
      source.onended = null;
      source.stop();
      source.disconnect();
    }
    if (this.sources.size === 0) return;
    this.sources.clear();
    this.changed(false);
  }

  private remove(source: Source): void {
    if (this.sources.delete(source) && this.sources.size === 0) this.changed(false);
  }
}
