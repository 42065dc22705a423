/** Tags with their labels, and flowers: drawn over both views, wherever these project a point of the map. */
import { type Sensor, idealRange, judge } from "@/map/health";
import { type Label, type Rectangle, placeLabels } from "@/map/labels";
import { writeValue } from "@/map/sensor_text";
import { speciesColor } from "@/map/species";
import type { Flower, Tag } from "@/map/twin";
import type { Point } from "@/map/view";
import { fade } from "@/widgets/canvas";
import { bodyFont, inks } from "./ink";
import { drawAlarm, drawHealth } from "./marks";

export type Project = (x: number, y: number, z: number) => Point;

export interface TagStyle {
  current: string;
  selected: string | null;
  layer: Sensor | null;
  /** The robot is stopped: nothing of the mission is alive. */
  isStopped: boolean;
  isSmall: boolean;
  /** Of texts, from textScale(). */
  textScale: number;
  /** Where no label should lie. */
  obstacles: Rectangle[];
}

/** How far before a tag, in m, its label begins: about where the robot stands to read it. */
const LEADER_M = 0.32;
const widths = new Map<string, number>();

function textWidth(context: CanvasRenderingContext2D, text: string): number {
  const key = `${context.font} ${text}`;
  let width = widths.get(key);
  if (width === undefined) {
    width = context.measureText(text).width;
    if (widths.size > 2000) widths.clear();
    widths.set(key, width);
  }
  return width;
}

/** Rings in the color of the species; the dashed one around it means a bug. */
export function drawFlowers(context: CanvasRenderingContext2D, project: Project, tags: readonly Tag[], scale: number): void {
  const radius = Math.max(3.5, Math.min(11, scale * 0.055));
  const shade = fade(inks().void, 0.7);
  for (const tag of tags) {
    for (const flower of tag.flowers) {
      const { x, y } = project(flower.x, flower.y, flower.z);
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.fillStyle = shade;
      context.fill();
      context.lineWidth = radius * 0.62;
      context.strokeStyle = speciesColor(flower.species);
      context.stroke();
      if (flower.hasBug) drawBugRing(context, x, y, radius + 5);
    }
  }
}

/** The rings of bugs alone, where the flowers themselves are drawn as solids. */
export function drawBugs(context: CanvasRenderingContext2D, project: (flower: Flower) => Point, tags: readonly Tag[], radius: number): void {
  for (const tag of tags) {
    for (const flower of tag.flowers) {
      if (!flower.hasBug) continue;
      const { x, y } = project(flower);
      drawBugRing(context, x, y, radius);
    }
  }
}

function drawBugRing(context: CanvasRenderingContext2D, x: number, y: number, radius: number): void {
  context.beginPath();
  context.setLineDash([3, 3]);
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.lineWidth = 2;
  context.strokeStyle = inks().attention;
  context.stroke();
  context.setLineDash([]);
}

/** At a scale in CSS pixels per meter. */
export function sightingRadius(scale: number): number {
  return Math.max(12, 0.16 * scale);
}

/** A ring around what was observed just now: double, so that it differs from flowers and bugs in more than its color. */
export function drawSightings(context: CanvasRenderingContext2D, project: (point: Point) => Point, sightings: readonly Point[], radius: number): void {
  context.strokeStyle = inks().sensed;
  for (const sighting of sightings) {
    const { x, y } = project(sighting);
    for (const [share, width] of [[1, 2.5], [1.45, 1.25]] as const) {
      context.beginPath();
      context.arc(x, y, radius * share, 0, 2 * Math.PI);
      context.lineWidth = width;
      context.stroke();
    }
  }
}

/** Where the robot and the end of its way are seen. */
export function motionObstacles(robot: Point | null, goal: Point | null): Rectangle[] {
  const around = ({ x, y }: Point, reach: number): Rectangle => ({ x: x - reach, y: y - reach, width: 2 * reach, height: 2 * reach });
  return [...(robot === null ? [] : [around(robot, 24)]), ...(goal === null ? [] : [around(goal, 13)])];
}

interface Pill extends Label {
  tag: Tag;
  isCurrent: boolean;
  size: number;
  hasMark: boolean;
}

function pillOf(context: CanvasRenderingContext2D, project: Project, tag: Tag, style: TagStyle): Pill | null {
  if (tag.at === null) return null;
  const isCurrent = tag.id === style.current;
  const size = Math.round(((style.isSmall ? 13 : 15) + (isCurrent ? 3 : 0)) * style.textScale);
  const hasMark = !style.isSmall || isCurrent || tag.health.state === "stressed" || tag.health.state === "critical";
  context.font = bodyFont(size);
  const text = tag.id.slice(0, 12);
  const height = size + (isCurrent ? 14 : 9);
  const width = textWidth(context, text) + (hasMark ? height * 0.5 + 21 : 16);
  const normal = tag.normal ?? { x: 0, y: -1 };
  const base = project(tag.at.x, tag.at.y, tag.at.z);
  const tip = project(tag.at.x + normal.x * LEADER_M, tag.at.y + normal.y * LEADER_M, 0);
  const direction = Math.atan2(tip.y - base.y, tip.x - base.x);
  const valueRoom = style.layer !== null && tag.readings[style.layer] !== undefined ? 22 * style.textScale : 0;
  return {
    id: tag.id,
    ...base,
    width,
    height: height + valueRoom,
    direction,
    priority: isCurrent ? 3 : tag.id === style.selected ? 2 : tag.health.state === "healthy" ? 0 : 1,
    tag,
    isCurrent,
    size,
    hasMark,
  };
}

/** Draw the tags; returns where their labels are. */
export function drawTags(context: CanvasRenderingContext2D, project: Project, tags: readonly Tag[], style: TagStyle): Map<string, Rectangle> {
  const pills = tags.flatMap((tag) => pillOf(context, project, tag, style) ?? []);
  const dots = pills.map(({ x, y }) => ({ x: x - 4, y: y - 4, width: 8, height: 8 }));
  const places = placeLabels(pills, [...style.obstacles, ...dots]);
  context.textBaseline = "middle";
  for (const pill of pills.toSorted((a, b) => a.priority - b.priority)) {
    const place = places.get(pill.id);
    if (place !== undefined) drawPill(context, pill, place, style);
  }
  return places;
}

function drawPill(context: CanvasRenderingContext2D, pill: Pill, place: Rectangle, style: TagStyle): void {
  const ink = inks();
  const { tag, isCurrent, size } = pill;
  const height = size + (isCurrent ? 14 : 9);
  const isRead = Object.keys(tag.readings).length > 0;
  const isSelected = tag.id === style.selected;
  const own = style.isStopped ? ink.text2 : ink.alive;
  const middleY = place.y + height / 2;
  context.strokeStyle = isCurrent ? own : fade(ink.text, 0.45);
  context.lineWidth = isCurrent ? 2 : 1;
  context.beginPath();
  context.moveTo(pill.x, pill.y);
  context.lineTo(clamp(pill.x, place.x + 8, place.x + place.width - 8), clamp(pill.y, place.y, place.y + height));
  context.stroke();
  context.beginPath();
  context.arc(pill.x, pill.y, isCurrent ? 4 : 3, 0, 2 * Math.PI);
  context.fillStyle = isCurrent ? own : ink.text;
  context.fill();

  context.beginPath();
  context.roundRect(place.x, place.y, place.width, height, height / 2);
  context.fillStyle = isCurrent ? own : isRead ? "#1d2822" : "#0c120f";
  context.fill();
  if (isSelected && isCurrent) {
    context.lineWidth = 2.5;
    context.strokeStyle = ink.text;
    context.stroke();
  } else {
    context.lineWidth = isSelected ? 2.5 : 1.25;
    context.strokeStyle = isCurrent ? own : isSelected ? ink.text : fade(ink.text, isRead ? 0.45 : 0.34);
    if (!isRead && !isSelected && !isCurrent) context.setLineDash([3, 3]);
    context.stroke();
    context.setLineDash([]);
  }
  const textX = pill.hasMark ? place.x + height * 0.5 + 12 : place.x + 8;
  if (pill.hasMark) drawHealth(context, place.x + height * 0.5 + 1, middleY, isCurrent ? 6 : 5, tag.health.state, isCurrent ? ink.aliveInk : undefined);
  context.font = bodyFont(size);
  context.textAlign = "left";
  context.fillStyle = isCurrent ? ink.aliveInk : isRead ? ink.text : ink.text2;
  context.fillText(tag.id.slice(0, 12), textX, middleY + 1);
  if (tag.hasBug) drawAlarm(context, place.x + place.width - 1, place.y + 2, 8, ink.attention, "#241800");
  if (style.layer !== null) drawValue(context, tag, style.layer, place.x + place.width / 2, place.y + height + 12 * style.textScale, style.textScale);
}

function clamp(value: number, low: number, high: number): number {
  return Math.min(high, Math.max(low, value));
}

/** The reading that a field was made of, with an arrow where it is out of its range. */
function drawValue(context: CanvasRenderingContext2D, tag: Tag, sensor: Sensor, x: number, y: number, scale: number): void {
  const value = tag.readings[sensor];
  if (value === undefined) return;
  const arrow = { low: " ▼", ideal: "", high: " ▲" }[judge(sensor, value).side];
  context.font = bodyFont(Math.round(16 * scale), 700);
  context.textAlign = "center";
  context.lineJoin = "round";
  context.lineWidth = 5;
  context.strokeStyle = fade(inks().void, 0.9);
  const text = `${writeValue(sensor, value)} ${idealRange(sensor).unit}${arrow}`;
  context.strokeText(text, x, y);
  context.fillStyle = inks().text;
  context.fillText(text, x, y);
  context.textAlign = "left";
}
