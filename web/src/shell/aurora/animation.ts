/** When the aurora is drawn: all the time at a slow pace, as long as that leaves the page its frames. */
import { FrameWatch } from "./frame_watch";
import { type Look, approach, isSettled } from "./mood";
import { createShader } from "./shader";

/** Drawn at a third of the page's size and scaled up by the compositor: it has no edges that would be seen. */
const SHARE = 1 / 3;
const MAX_PIXELS = 320_000;
const FRAME_MS = 1000 / 30;
/** Between moods the drift is so slow that fewer frames look the same, at a third of the work. */
const CALM_FRAME_MS = 1000 / 10;
/** How fast the noise drifts at full pace, per second. */
const DRIFT = 0.024;
const START = 12.4;

export interface Animation {
  /** Go over to another look. */
  show: (look: Look) => void;
  end: () => void;
}

/** Whether frames took long while it was drawn: then it is not drawn again in this page. */
let isDropped = false;

/**
 * Draw until it is ended, or until frames take long: a page of few frames a second is late with the stop, too. Without a
 * graphics processor or with reduced motion, the canvas is hidden and the gradient below it is seen.
 */
export function animate(canvas: HTMLCanvasElement, first: Look): Animation {
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const open = () => (still.matches || isDropped ? null : createShader(canvas));
  const watch = new FrameWatch();
  let shader = open();
  let goal = first;
  let look = first;
  let time = START;
  let lastMs = 0;
  let frame = 0;
  canvas.hidden = shader === null;

  const draw = (nowMs: number) => {
    if (watch.isSlow(nowMs)) {
      drop();
      return;
    }
    frame = requestAnimationFrame(draw);
    if (nowMs - lastMs < (isSettled(look, goal) ? CALM_FRAME_MS : FRAME_MS) - 2) return;
    const stepS = lastMs === 0 ? 0 : Math.min(0.2, (nowMs - lastMs) / 1000);
    lastMs = nowMs;
    look = approach(look, goal, stepS);
    time += stepS * DRIFT * look.pace;
    shader?.draw(look, time);
  };
  const begin = () => {
    cancelAnimationFrame(frame);
    if (shader !== null && !document.hidden) frame = requestAnimationFrame(draw);
  };
  const fit = () => {
    const { clientWidth, clientHeight } = document.documentElement;
    const share = Math.min(SHARE, Math.sqrt(MAX_PIXELS / Math.max(1, clientWidth * clientHeight)));
    shader?.resize(Math.max(1, Math.round(clientWidth * share)), Math.max(1, Math.round(clientHeight * share)));
    lastMs = 0;
    begin();
  };
  const onVisibility = () => {
    watch.reset();
    begin();
  };
  const onMotion = () => {
    shader = open();
    canvas.hidden = shader === null;
    fit();
  };
  // A browser may take the context back, for example when its graphics process ends.
  const onLost = (event: Event) => {
    event.preventDefault();
    shader = null;
    canvas.hidden = true;
    begin();
  };
  const end = () => {
    cancelAnimationFrame(frame);
    window.removeEventListener("resize", fit);
    document.removeEventListener("visibilitychange", onVisibility);
    still.removeEventListener("change", onMotion);
    canvas.removeEventListener("webglcontextlost", onLost);
    canvas.removeEventListener("webglcontextrestored", onMotion);
  };
  const drop = () => {
    isDropped = true;
    end();
    shader?.release();
    shader = null;
    canvas.hidden = true;
  };

  fit();
  window.addEventListener("resize", fit);
  document.addEventListener("visibilitychange", onVisibility);
  still.addEventListener("change", onMotion);
  canvas.addEventListener("webglcontextlost", onLost);
  canvas.addEventListener("webglcontextrestored", onMotion);
  return {
    show: (next) => {
      if (next === goal) return;
      goal = next;
      begin();
    },
    end,
  };
}
