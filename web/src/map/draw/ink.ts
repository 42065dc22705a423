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

export function inks(): Ink {
  ink ??= {
    alive: cssColor("--color-alive"),
    aliveDim: cssColor("--color-alive-2"),
    aliveInk: cssColor("--color-alive-ink"),
    sensed: cssColor("--color-sensed"),
    attention: cssColor("--color-attention"),
    stop: cssColor("--color-stop"),
    stopText: cssColor("--color-stop-text"),
    text: cssColor("--color-text"),
    text2: cssColor("--color-text-2"),
    text3: cssColor("--color-text-3"),
    panel: cssColor("--color-panel"),
    raised: cssColor("--color-raised"),
    void: cssColor("--color-void"),
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
  return `${weight} ${sizePx}px ${cssColor("--font-sans")}`;
}
