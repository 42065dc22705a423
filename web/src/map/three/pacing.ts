/** How often the scene may be drawn on a machine whose processor computes every pixel, so that the page stays fluent. */

/** Data needs no more frames than these. */
const SHORTEST_MS = 33;
const LONGEST_MS = 250;
/** An animation frame of a page that is not late. */
const ANIMATION_FRAME_MS = 1000 / 60;
/** What a frame of the scene costs shows in as many animation frames after it: the browser draws ahead of the screen. */
export const WATCHED_FRAMES = 3;
/** The share that a new measurement has in the known cost. */
const NEWEST_SHARE = 0.25;
/** From this cost on, frames are drawn with fewer pixels while the camera moves. */
const SLOW_MS = 40;

/** The scene gets at most half of the time: then pages with a frame of up to 60 ms still have 30 frames a second. */
const SCENE_SHARE = 0.5;

/** Learns what a frame of the scene costs, and says how long to wait between two of them. */
export class FramePacer {
  private costMs = ANIMATION_FRAME_MS;

  /** `drawn` frames of the scene were begun from `beganMs` on; the animation frame `WATCHED_FRAMES` later came at `nowMs`. */
  measured(beganMs: number, nowMs: number, drawn = 1): void {
    // A page that was hidden has no animation frames: that says nothing of the cost.
    const lateMs = Math.min(LONGEST_MS, Math.max(0, nowMs - beganMs - WATCHED_FRAMES * ANIMATION_FRAME_MS));
    this.costMs += NEWEST_SHARE * (ANIMATION_FRAME_MS + lateMs / drawn - this.costMs);
  }

  /** From the beginning of one frame to that of the next, ms. */
  get periodMs(): number {
    return Math.min(LONGEST_MS, Math.max(SHORTEST_MS, this.costMs / SCENE_SHARE));
  }

  get isSlow(): boolean {
    return this.costMs > SLOW_MS;
  }
}
