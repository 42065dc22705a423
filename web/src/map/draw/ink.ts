/** How both views of the map look: the page's tokens, the greenhouse's own colors, and the sizes of what is drawn on the floor. */
import { type CellKind, ENCLOSED, FLOOR, OUTSIDE, type Palette, VAGUE, WALLED } from "@/map/grid";
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
  };
  return ink;
}

/** The ring around the robot, m. */
export const RING_M = 0.36;
/** The part of the trail that is drawn strongly, ms. */
export const FRESH_TRAIL_MS = 45_000;
/** The floor that the lidar sees is lit this far, m, from this opacity down to none. */
export const SCAN_LIGHT_M = 3.4;
export const SCAN_LIGHT_OPACITY = 0.15;
/** The lines at every meter. */
export const METERS = { color: "rgb(223, 245, 230)", opacity: 0.07 } as const;
/** A plan that is not followed. */
export const OLD_PLAN = "rgb(125, 135, 128)";

/** The robot where its pose is known, where it is stopped, and where it was last. */
export function robotColor({ isPoseStale, isStopped }: { isPoseStale: boolean; isStopped: boolean }): string {
  const { text3, stopText, alive } = inks();
  return isPoseStale ? text3 : isStopped ? stopText : alive;
}

/** A color of the palette, such as that of the walls. */
export function cellColor(kind: CellKind): string {
  return `rgb(${PALETTE[kind].slice(0, 3).join(", ")})`;
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
