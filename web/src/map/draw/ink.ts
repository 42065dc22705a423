/** The colors of the map: the page's tokens, and the greenhouse's own. */
import type { Palette } from "@/map/grid";
import { ENCLOSED, FLOOR, OUTSIDE, VAGUE, WALLED } from "@/map/grid";
import { cssColor } from "@/widgets/canvas";

export interface Ink {
  alive: string;
  aliveDim: string;
  aliveInk: string;
  sensed: string;
  attention: string;
  stop: string;
  stopText: string;
  text: string;
  text2: string;
  text3: string;
  panel: string;
  raised: string;
  void: string;
  line: string;
}

let ink: Ink | null = null;

/** Of the dark theme, which the map has always. */
export function inks(): Ink {
  ink ??= {
    alive: cssColor("--color-alive", "dark"),
    aliveDim: cssColor("--color-alive-2", "dark"),
    aliveInk: cssColor("--color-alive-ink", "dark"),
    sensed: cssColor("--color-sensed", "dark"),
    attention: cssColor("--color-attention", "dark"),
    stop: cssColor("--color-stop", "dark"),
    stopText: cssColor("--color-stop-text", "dark"),
    text: cssColor("--color-text", "dark"),
    text2: cssColor("--color-text-2", "dark"),
    text3: cssColor("--color-text-3", "dark"),
    panel: cssColor("--color-panel", "dark"),
    raised: cssColor("--color-raised", "dark"),
    void: cssColor("--color-void", "dark"),
    line: "rgb(223 245 230 / 0.07)",
  };
  return ink;
}

/** From above: floor, half-known cells, walls, and the inside of what is enclosed by walls. */
export const PALETTE: Palette = {
  [OUTSIDE]: [0, 0, 0, 0],
  [FLOOR]: [23, 33, 27, 255],
  [VAGUE]: [62, 80, 69, 255],
  [WALLED]: [178, 210, 190, 255],
  [ENCLOSED]: [36, 50, 41, 255],
};

/** How much larger than usual the page writes, as on a wall. */
export function textScale(): number {
  return Math.max(1, parseFloat(getComputedStyle(document.documentElement).fontSize) / 16 || 1);
}

export function bodyFont(sizePx: number, weight = 600): string {
  return `${weight} ${sizePx}px ${getComputedStyle(document.body).fontFamily}`;
}
