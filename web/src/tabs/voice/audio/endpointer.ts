/** When an utterance begins and ends, by the loudness of the microphone. */

export interface EndpointerRules {
  /** Loudness, 0 to 1. */
  startThreshold: number;
  endThreshold: number;
  /** Silence that ends an utterance, ms. */
  endHoldMs: number;
  maxUtteranceMs: number;
}

/** A click is shorter than a syllable. */
const BEGINS_AFTER_MS = 100;

export class Endpointer {
  isSpeaking = false;
  private loudMs = 0;
  private silentMs = 0;
  private spokenMs = 0;
  /** After the longest utterance, nothing begins before there was silence: what does not end is no speech. */
  private mustFall = false;

  constructor(private readonly rules: () => EndpointerRules) {}

  /** Take the loudness of the next `durationMs`; returns whether an utterance begins or ends with it. */
  take(loudness: number, durationMs: number): "begin" | "end" | null {
    const { startThreshold, endHoldMs, maxUtteranceMs } = this.rules();
    const isSilent = loudness < Math.min(this.rules().endThreshold, startThreshold);
    this.silentMs = isSilent ? this.silentMs + durationMs : 0;
    if (!this.isSpeaking) {
      if (this.silentMs >= endHoldMs) this.mustFall = false;
      this.loudMs = loudness >= startThreshold && !this.mustFall ? this.loudMs + durationMs : 0;
      if (this.loudMs < BEGINS_AFTER_MS) return null;
      this.begin();
      return "begin";
    }
    this.spokenMs += durationMs;
    const isTooLong = this.spokenMs >= maxUtteranceMs;
    if (this.silentMs < endHoldMs && !isTooLong) return null;
    this.mustFall = isTooLong;
    this.reset();
    return "end";
  }

  /** Wait for the next utterance. */
  reset(): void {
    this.isSpeaking = false;
    this.loudMs = 0;
  }

  private begin(): void {
    this.isSpeaking = true;
    this.spokenMs = this.loudMs;
    this.silentMs = 0;
  }
}
