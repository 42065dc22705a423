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

type Scheme = "light" | "dark";

const colors = new Map<string, string>();

/** The value of a color's token, such as `--color-alive`, in a theme: that of the page, unless another one is named. */
export function cssColor(token: string, scheme: Scheme = pageScheme()): string {
  const contrast = document.documentElement.classList.contains("high-contrast");
  const key = `${scheme} ${contrast} ${token}`;
  let color = colors.get(key);
  if (color === undefined) {
    color = resolve(token, scheme);
    colors.set(key, color);
  }
  return color;
}

/** A color as `cssColor` gives it, with an opacity. */
export function fade(color: string, opacity: number): string {
  return `rgb(${(color.match(/[\d.]+/g) ?? []).slice(0, 3).join(" ")} / ${opacity})`;
}

function pageScheme(): Scheme {
  return document.documentElement.classList.contains("light") ? "light" : "dark";
}

/** A token's value depends on the theme; the browser decides it for an element. */
function resolve(token: string, scheme: Scheme): string {
  const probe = document.createElement("span");
  probe.style.colorScheme = scheme;
  probe.style.color = `var(${token})`;
  document.documentElement.append(probe);
  const { color } = getComputedStyle(probe);
  probe.remove();
  return color;
}
