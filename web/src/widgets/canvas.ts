/** Drawing on canvases in CSS pixels and the page's own colors. */

const MAX_PIXEL_RATIO = 2;

/** The context of a canvas whose bitmap fits its size on the page, scaled to CSS pixels; null while it has no size. */
export function fitCanvas(canvas: HTMLCanvasElement): { context: CanvasRenderingContext2D; width: number; height: number } | null {
  const { clientWidth: width, clientHeight: height } = canvas;
  const context = canvas.getContext("2d");
  if (context === null || width === 0 || height === 0) return null;
  const ratio = Math.min(window.devicePixelRatio, MAX_PIXEL_RATIO);
  const [bitmapWidth, bitmapHeight] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== bitmapWidth || canvas.height !== bitmapHeight) {
    canvas.width = bitmapWidth;
    canvas.height = bitmapHeight;
  }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height };
}

let colors: CSSStyleDeclaration | null = null;

/** The value of a token, such as `--color-alive`. */
export function cssColor(token: string): string {
  colors ??= getComputedStyle(document.documentElement);
  return colors.getPropertyValue(token).trim();
}
