/** Asks for frames of the scene: data comes from several topics at ten times a second each, and is drawn together. */
import { drawsInSoftware } from "@/map/webgl";

const PERIOD_MS = 33;
const SOFTWARE_PERIOD_MS = 80;

let timer: ReturnType<typeof setTimeout> | undefined;
let lastMs = -Infinity;

/** Draw what data changed: soon, but not more often than this browser can. */
export function requestFrame(invalidate: () => void): void {
  if (timer !== undefined) return;
  const period = drawsInSoftware() ? SOFTWARE_PERIOD_MS : PERIOD_MS;
  timer = setTimeout(
    () => {
      timer = undefined;
      lastMs = performance.now();
      invalidate();
    },
    Math.max(0, period - (performance.now() - lastMs)),
  );
}
