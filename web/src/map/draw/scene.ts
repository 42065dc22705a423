/** What stands still, drawn from above: the floor and its walls, a field, and boxes. */
import { ENCLOSED, type Grid, WALLED, fromCells, paint } from "@/map/grid";
import { paintField } from "@/map/heat";
import type { LiveMap, ShownGrid } from "@/map/live_map";
import { type Point, type Size, type View, toScreen, toWorld } from "@/map/view";
import { fade } from "@/widgets/canvas";
import { METERS, PALETTE, cellColor } from "./ink";

/** Draws pixels of the grid that are only made anew when they change. */
export class SceneDrawing {
  private floor: HTMLCanvasElement | null = null;
  private floorVersion = -1;
  private heat: HTMLCanvasElement | null = null;
  private heatOf: unknown = null;
  private heatVersion = -1;

  draw(context: CanvasRenderingContext2D, view: View, size: Size, live: LiveMap): void {
    const shown = live.grid;
    if (shown === null) {
      drawMeters(context, view, size);
      return;
    }
    this.update(live, shown);
    if (this.floor !== null) drawPixels(context, view, size, shown.grid, this.floor, false);
    if (live.field !== null && this.heat !== null) drawPixels(context, view, size, shown.grid, this.heat, true);
    drawMeters(context, view, size);
    drawBoxes(context, view, size, live);
  }

  private update(live: LiveMap, shown: ShownGrid): void {
    if (this.floorVersion !== shown.version) {
      this.floor = toCanvas(shown.grid, paint(shown.grid, shown.kinds, PALETTE));
      this.floorVersion = shown.version;
    }
    if (live.field !== null && (this.heatOf !== live.field || this.heatVersion !== shown.version)) {
      this.heat = toCanvas(shown.grid, paintField(live.field, shown.grid, shown.kinds));
      this.heatOf = live.field;
      this.heatVersion = shown.version;
    }
  }
}

export function toCanvas(grid: Grid, pixels: Uint8ClampedArray<ArrayBuffer>): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = grid.width;
  canvas.height = grid.height;
  canvas.getContext("2d")?.putImageData(new ImageData(pixels, grid.width, grid.height), 0, 0);
  return canvas;
}

/** Draw a picture of the grid where the grid is: its last row first, turned as its rows are. */
function drawPixels(context: CanvasRenderingContext2D, view: View, size: Size, grid: Grid, picture: HTMLCanvasElement, smooth: boolean): void {
  const corner = toScreen(view, size, fromCells(grid, 0, grid.height));
  const right = toScreen(view, size, fromCells(grid, 1, grid.height));
  const down = toScreen(view, size, fromCells(grid, 0, grid.height - 1));
  context.save();
  context.imageSmoothingEnabled = smooth;
  context.transform(right.x - corner.x, right.y - corner.y, down.x - corner.x, down.y - corner.y, corner.x, corner.y);
  context.drawImage(picture, 0, 0);
  context.restore();
}

/** A line at every meter, at every five where they would lie too close. */
function drawMeters(context: CanvasRenderingContext2D, view: View, size: Size): void {
  const step = view.scale > 18 ? 1 : 5;
  const [a, b] = [toWorld(view, size, { x: 0, y: 0 }), toWorld(view, size, { x: size.width, y: size.height })];
  const [minX, maxX] = [Math.min(a.x, b.x), Math.max(a.x, b.x)];
  const [minY, maxY] = [Math.min(a.y, b.y), Math.max(a.y, b.y)];
  context.strokeStyle = fade(METERS.color, METERS.opacity);
  context.lineWidth = 1;
  context.beginPath();
  for (let x = Math.ceil(minX / step) * step; x <= maxX; x += step) {
    const pixel = Math.round(toScreen(view, size, { x, y: 0 }).x) + 0.5;
    context.moveTo(pixel, 0);
    context.lineTo(pixel, size.height);
  }
  for (let y = Math.ceil(minY / step) * step; y <= maxY; y += step) {
    const pixel = Math.round(toScreen(view, size, { x: 0, y }).y) + 0.5;
    context.moveTo(0, pixel);
    context.lineTo(size.width, pixel);
  }
  context.stroke();
}

/** The measured boxes as outlines, and the footprints of the flowers' boxes that the twin keeps. */
function drawBoxes(context: CanvasRenderingContext2D, view: View, size: Size, live: LiveMap): void {
  const outline = (corners: readonly Point[], dash: number[]) => {
    context.setLineDash(dash);
    context.beginPath();
    corners.forEach((corner, index) => {
      const { x, y } = toScreen(view, size, corner);
      if (index === 0) context.moveTo(x, y);
      else context.lineTo(x, y);
    });
    context.closePath();
    context.fill();
    context.stroke();
  };
  context.fillStyle = fade(cellColor(ENCLOSED), 0.6);
  context.strokeStyle = fade(cellColor(WALLED), 0.75);
  context.lineWidth = 1.25;
  for (const box of live.boxes) outline(box.corners, []);
  const measured = new Set(live.boxes.map((box) => box.id));
  context.strokeStyle = fade(cellColor(WALLED), 0.5);
  for (const tag of live.tags) if (tag.footprint.length >= 3 && !measured.has(tag.id)) outline(tag.footprint, [4, 3]);
  context.setLineDash([]);
}
