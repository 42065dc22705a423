/** Notices a page that draws few frames a second, by the times of its animation frames. */

/** Frames are slow where half of them take longer than this: 25 a second. */
const SLOW_MS = 40;
/** How many frames are judged together; a page that is very slow is judged after a second, by fewer. */
const FRAMES = 20;
const LONGEST_MS = 1000;
/** One stall, such as the opening of a view, must not decide. */
const FEWEST_FRAMES = 5;

export class FrameWatch {
  private lastMs: number | null = null;
  private periodsMs: number[] = [];

  /** Note a frame; whether those up to it were slow. */
  isSlow(frameMs: number): boolean {
    if (this.lastMs !== null) this.periodsMs.push(frameMs - this.lastMs);
    this.lastMs = frameMs;
    const count = this.periodsMs.length;
    const spanMs = this.periodsMs.reduce((sum, period) => sum + period, 0);
    if (count < FRAMES && (count < FEWEST_FRAMES || spanMs < LONGEST_MS)) return false;
    const median = this.periodsMs.toSorted((a, b) => a - b)[count >> 1] ?? 0;
    this.periodsMs = [];
    return median > SLOW_MS;
  }

  /** Begin anew, as after a time without frames. */
  reset(): void {
    this.lastMs = null;
    this.periodsMs = [];
  }
}
