/** Asks for frames of the scene: data comes from several topics at ten times a second each, and is drawn together. */
import { drawsInSoftware } from "@/widgets/webgl";
import { FramePacer, WATCHED_FRAMES } from "./pacing";

const pacer = new FramePacer();

let timer: ReturnType<typeof setTimeout> | undefined;
let draw = () => {};
let lastMs = -Infinity;
/** Frames that were drawn since the one that is being measured. */
let drawn = 0;

/** Draw what data changed: soon, but not more often than this browser can. */
export function requestFrame(invalidate: () => void): void {
  draw = invalidate;
  if (timer !== undefined) return;
  timer = setTimeout(
    () => {
      timer = undefined;
      lastMs = performance.now();
      draw();
    },
    Math.max(0, pacer.periodMs - (performance.now() - lastMs)),
  );
}

/** Measure what the frame costs that is being drawn. A graphics processor needs no pacing. */
export function measureFrame(): void {
  if (!drawsInSoftware()) return;
  drawn += 1;
  if (drawn > 1) return;
  const beganMs = performance.now();
  let left = WATCHED_FRAMES;
  const watch = () => {
    left -= 1;
    if (left > 0) {
      requestAnimationFrame(watch);
      return;
    }
    pacer.measured(beganMs, performance.now(), drawn);
    drawn = 0;
  };
  requestAnimationFrame(watch);
}

/** Whether frames take so long that they need fewer pixels while the camera moves. */
export function isSlow(): boolean {
  return pacer.isSlow;
}
