/** Draws what a mock camera sees: the greenhouse by ray casting, with its tags and flowers. */
import { speciesColor } from "@/map/species";
import { TABLE, TABLE_HEIGHT_M, TAGS, TAG_EDGE_M, WALL_HEIGHT_M, castRay } from "./greenhouse";
import { type Camera, IMAGE, type Pixel, horizon, project, seenFlowers, tagCorners } from "./view";
import { noise } from "./messages";

const COLUMN_PX = 4;
const REACH_M = 12;
/** The white border around a tag, in edges. */
const PAPER = 1.3;
const TAG_CELLS = 8;

export function drawImage(context: CanvasRenderingContext2D, camera: Camera): void {
  const { height } = IMAGE;
  const middle = horizon(camera);
  gradient(context, 0, middle, "#5f9fdc", "#a9cdea");
  gradient(context, middle, height, "#4c5645", "#6d7365");
  const depths = drawWalls(context, camera, middle);
  for (const tag of TAGS) drawTag(context, camera, tag.pose, tag.id, depths);
  drawFlowers(context, camera, depths);
}

function gradient(context: CanvasRenderingContext2D, top: number, bottom: number, from: string, to: string): void {
  const fill = context.createLinearGradient(0, top, 0, bottom);
  fill.addColorStop(0, from);
  fill.addColorStop(1, to);
  context.fillStyle = fill;
  context.fillRect(0, top, IMAGE.width, bottom - top);
}

/** Draws walls and tables; returns the depth of each column, m. */
function drawWalls(context: CanvasRenderingContext2D, camera: Camera, middle: number): Float32Array {
  const depths = new Float32Array(IMAGE.width / COLUMN_PX);
  for (let column = 0; column < depths.length; column += 1) {
    const offset = (IMAGE.width / 2 - (column + 0.5) * COLUMN_PX) / IMAGE.focal;
    const angle = camera.yaw + Math.atan(offset);
    const { distanceM, hit } = castRay(camera.x, camera.y, angle, REACH_M);
    const depth = Math.max(0.05, distanceM * Math.cos(angle - camera.yaw));
    depths[column] = depth;
    const isTable = hit === TABLE;
    const topM = isTable ? TABLE_HEIGHT_M : WALL_HEIGHT_M;
    const top = middle + (IMAGE.focal * (camera.z - topM)) / depth;
    const bottom = middle + (IMAGE.focal * camera.z) / depth;
    const shade = Math.max(0.45, 1 - depth / 9);
    // Edges catch more light where the ray hits across the grid.
    const grain = 1 + 0.03 * noise(Math.round((camera.x + distanceM * Math.cos(angle)) * 8) + Math.round((camera.y + distanceM * Math.sin(angle)) * 8) * 97);
    context.fillStyle = isTable ? rgb(134, 98, 48, shade * grain) : rgb(104, 142, 128, shade * grain);
    if (isTable && camera.z > topM) {
      // The top of the table, up to its far edge.
      const farTop = middle + (IMAGE.focal * (camera.z - topM)) / (depth + 0.5);
      context.fillRect(column * COLUMN_PX, top, COLUMN_PX, bottom - top);
      context.fillStyle = rgb(88, 62, 34, shade);
      context.fillRect(column * COLUMN_PX, farTop, COLUMN_PX, top - farTop);
    } else context.fillRect(column * COLUMN_PX, top, COLUMN_PX, bottom - top);
  }
  return depths;
}

function drawTag(
  context: CanvasRenderingContext2D,
  camera: Camera,
  pose: { x: number; y: number; yaw: number },
  id: string,
  depths: Float32Array,
): void {
  const paper = corners(camera, pose, TAG_EDGE_M * PAPER);
  const print = corners(camera, pose, TAG_EDGE_M);
  if (paper === null || print === null || isBehind(paper, depths)) return;
  const cosine = Math.cos(Math.atan2(camera.y - pose.y, camera.x - pose.x) - pose.yaw);
  if (cosine <= 0.05) return;
  fillQuad(context, paper, 0, 0, 1, 1, "#d8cfae");
  fillQuad(context, print, 0, 0, 1, 1, "#26282b");
  for (let row = 1; row < TAG_CELLS - 1; row += 1) {
    for (let column = 1; column < TAG_CELLS - 1; column += 1) {
      if (noise(Number(id) * 61 + row * 8 + column) > 0.1) {
        fillQuad(context, print, column / TAG_CELLS, row / TAG_CELLS, (column + 1.08) / TAG_CELLS, (row + 1.08) / TAG_CELLS, "#d8cfae");
      }
    }
  }
}

function corners(camera: Camera, pose: { x: number; y: number; yaw: number }, edgeM: number): Pixel[] | null {
  const found = tagCorners(pose, edgeM).map(({ x, y, z }) => project(camera, x, y, z));
  return found.every((corner) => corner !== null) ? (found as Pixel[]) : null;
}

function isBehind(pixels: readonly Pixel[], depths: Float32Array): boolean {
  const u = pixels.reduce((sum, pixel) => sum + pixel.u, 0) / pixels.length;
  const depth = pixels.reduce((sum, pixel) => sum + pixel.depthM, 0) / pixels.length;
  const seen = depths[Math.floor(u / COLUMN_PX)];
  return seen === undefined || depth > seen + 0.12;
}

/** Fill a part of a quad, given in shares of its sides. */
function fillQuad(
  context: CanvasRenderingContext2D,
  [topLeft, topRight, bottomRight, bottomLeft]: readonly Pixel[],
  left: number,
  top: number,
  right: number,
  bottom: number,
  color: string,
): void {
  if (topLeft === undefined || topRight === undefined || bottomRight === undefined || bottomLeft === undefined) return;
  const at = (x: number, y: number): [number, number] => [
    (1 - y) * ((1 - x) * topLeft.u + x * topRight.u) + y * ((1 - x) * bottomLeft.u + x * bottomRight.u),
    (1 - y) * ((1 - x) * topLeft.v + x * topRight.v) + y * ((1 - x) * bottomLeft.v + x * bottomRight.v),
  ];
  context.fillStyle = color;
  context.beginPath();
  context.moveTo(...at(left, top));
  context.lineTo(...at(right, top));
  context.lineTo(...at(right, bottom));
  context.lineTo(...at(left, bottom));
  context.closePath();
  context.fill();
}

function drawFlowers(context: CanvasRenderingContext2D, camera: Camera, depths: Float32Array): void {
  for (const { species, bug, u, v, sizePx, stemV, depthM } of seenFlowers(camera, TABLE_HEIGHT_M)) {
    const wall = depths[Math.floor(u / COLUMN_PX)];
    // A flower stands behind the front of its own table.
    if (wall === undefined || depthM > wall + 0.6) continue;
    context.fillStyle = "#2f7d32";
    context.fillRect(u - sizePx * 0.07, v, sizePx * 0.14, stemV - v);
    context.beginPath();
    context.ellipse(u + sizePx * 0.25, (v + stemV) / 2, sizePx * 0.18, sizePx * 0.6, 0.4, 0, 2 * Math.PI);
    context.fill();
    context.fillStyle = speciesColor(species);
    context.beginPath();
    context.moveTo(u - sizePx * 0.45, v - sizePx * 0.5);
    context.lineTo(u - sizePx * 0.2, v - sizePx * 0.15);
    context.lineTo(u, v - sizePx * 0.6);
    context.lineTo(u + sizePx * 0.2, v - sizePx * 0.15);
    context.lineTo(u + sizePx * 0.45, v - sizePx * 0.5);
    context.quadraticCurveTo(u + sizePx * 0.5, v + sizePx * 0.5, u, v + sizePx * 0.5);
    context.quadraticCurveTo(u - sizePx * 0.5, v + sizePx * 0.5, u - sizePx * 0.45, v - sizePx * 0.5);
    context.fill();
    if (!bug) continue;
    context.fillStyle = "#141414";
    context.beginPath();
    context.ellipse(u + sizePx * 0.1, v + sizePx * 0.1, sizePx * 0.16, sizePx * 0.1, 0.5, 0, 2 * Math.PI);
    context.fill();
  }
}

function rgb(red: number, green: number, blue: number, share: number): string {
  return `rgb(${Math.round(red * share)} ${Math.round(green * share)} ${Math.round(blue * share)})`;
}
