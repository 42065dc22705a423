/** The view of the map from above: which part of the world is where on the screen. */

/** A point of the map, m. */
export interface Point {
  x: number;
  y: number;
}

/** A rectangle of the map, m. */
export interface Bounds {
  minX: number;
  minY: number;
  maxX: number;
  maxY: number;
}

/** A size on the screen, CSS pixels. */
export interface Size {
  width: number;
  height: number;
}

export interface View {
  /** The point of the map in the middle of the screen. */
  x: number;
  y: number;
  /** CSS pixels per meter. */
  scale: number;
  /** Whether the map is turned by 180 degrees, for the setting `polarityInvertHmi`. */
  turned: boolean;
}

/** CSS pixels that a fitted map keeps free at each edge. */
export interface Margins {
  top: number;
  right: number;
  bottom: number;
  left: number;
}

const MIN_SCALE = 8;
export const MAX_SCALE = 400;

export function toScreen(view: View, size: Size, point: Point): Point {
  const sign = view.turned ? -1 : 1;
  return {
    x: size.width / 2 + sign * (point.x - view.x) * view.scale,
    y: size.height / 2 - sign * (point.y - view.y) * view.scale,
  };
}

export function toWorld(view: View, size: Size, pixel: Point): Point {
  const sign = view.turned ? -1 : 1;
  return {
    x: view.x + (sign * (pixel.x - size.width / 2)) / view.scale,
    y: view.y - (sign * (pixel.y - size.height / 2)) / view.scale,
  };
}

/** A heading of the map as an angle on the screen, whose y axis points down. */
export function toScreenAngle(view: View, yaw: number): number {
  return -(view.turned ? yaw + Math.PI : yaw);
}

/** Zoom by a factor so that the point of the map below `pixel` stays there. */
export function zoomAt(view: View, size: Size, pixel: Point, factor: number): View {
  const scale = clampScale(view.scale * factor);
  const held = toWorld(view, size, pixel);
  const sign = view.turned ? -1 : 1;
  return {
    ...view,
    scale,
    x: held.x - (sign * (pixel.x - size.width / 2)) / scale,
    y: held.y + (sign * (pixel.y - size.height / 2)) / scale,
  };
}

/** Move the map by CSS pixels. */
export function panBy(view: View, pixels: Point): View {
  const sign = view.turned ? -1 : 1;
  return { ...view, x: view.x - (sign * pixels.x) / view.scale, y: view.y + (sign * pixels.y) / view.scale };
}

/** The view that shows all of `bounds` within the margins. */
export function fit(bounds: Bounds, size: Size, margins: Margins, turned: boolean): View {
  const width = Math.max(1, size.width - margins.left - margins.right);
  const height = Math.max(1, size.height - margins.top - margins.bottom);
  const spanX = Math.max(0.5, bounds.maxX - bounds.minX);
  const spanY = Math.max(0.5, bounds.maxY - bounds.minY);
  const scale = clampScale(Math.min(width / spanX, height / spanY));
  const centered: View = { x: (bounds.minX + bounds.maxX) / 2, y: (bounds.minY + bounds.maxY) / 2, scale, turned };
  return panBy(centered, { x: (margins.left - margins.right) / 2, y: (margins.top - margins.bottom) / 2 });
}

function clampScale(scale: number): number {
  return Math.min(MAX_SCALE, Math.max(MIN_SCALE, scale));
}

export function boundsOf(points: Iterable<Point>): Bounds | null {
  let bounds: Bounds | null = null;
  for (const { x, y } of points) {
    if (!Number.isFinite(x) || !Number.isFinite(y)) continue;
    bounds =
      bounds === null
        ? { minX: x, minY: y, maxX: x, maxY: y }
        : {
            minX: Math.min(bounds.minX, x),
            minY: Math.min(bounds.minY, y),
            maxX: Math.max(bounds.maxX, x),
            maxY: Math.max(bounds.maxY, y),
          };
  }
  return bounds;
}

export function union(first: Bounds | null, second: Bounds | null): Bounds | null {
  if (first === null) return second;
  if (second === null) return first;
  return {
    minX: Math.min(first.minX, second.minX),
    minY: Math.min(first.minY, second.minY),
    maxX: Math.max(first.maxX, second.maxX),
    maxY: Math.max(first.maxY, second.maxY),
  };
}

export function grow(bounds: Bounds, byM: number): Bounds {
  return { minX: bounds.minX - byM, minY: bounds.minY - byM, maxX: bounds.maxX + byM, maxY: bounds.maxY + byM };
}

/** The longest of 1, 2 and 5 times a power of ten meters that is at most `longestPx` long. */
export function scaleBar(scale: number, longestPx: number): { meters: number; pixels: number } {
  const longestM = longestPx / scale;
  const power = 10 ** Math.floor(Math.log10(longestM));
  const meters = power * ([5, 2, 1].find((step) => step * power <= longestM) ?? 1);
  return { meters, pixels: meters * scale };
}
