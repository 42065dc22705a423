/** Labels and drawn poses over the scene, on a canvas of their own: text stays sharp and upright. */
import { useFrame, useThree } from "@react-three/fiber";
import { type RefObject, useEffect, useRef } from "react";
import type { OrthographicCamera } from "three";
import { drawDraft, drawFootprint } from "@/map/draw/motion";
import { textScale } from "@/map/draw/ink";
import { drawBugs, drawSightings, drawTags, motionObstacles, sightingRadius } from "@/map/draw/tags";
import type { Rectangle } from "@/map/labels";
import { liveMap } from "@/map/live_map";
import type { Presentation } from "@/map/renderer";
import { shownPlan } from "@/map/route";
import { shownSightings } from "@/map/sightings";
import type { Flower } from "@/map/twin";
import type { Point } from "@/map/view";
import { viewNow } from "@/hooks/view_clock";
import { fitCanvas } from "@/widgets/canvas";
import { projectPoint } from "./camera";
import { stemOf } from "./walls";

interface LabelsProps {
  overlayRef: RefObject<HTMLCanvasElement | null>;
  placesRef: RefObject<ReadonlyMap<string, Rectangle>>;
  presentation: Presentation;
}

export function Labels({ overlayRef, placesRef, presentation }: LabelsProps) {
  const camera = useThree((state) => state.camera) as OrthographicCamera;
  const invalidate = useThree((state) => state.invalidate);
  const presented = useRef(presentation);
  useEffect(() => {
    presented.current = presentation;
    invalidate();
  }, [presentation, invalidate]);
  const drawn = useRef<readonly unknown[]>([]);
  useFrame(() => {
    const canvas = overlayRef.current;
    if (canvas === null) return;
    const size = { width: canvas.clientWidth, height: canvas.clientHeight };
    const project = (x: number, y: number, z: number): Point => projectPoint(camera, size, x, y, z);
    const onFloor = (point: Point): Point => project(point.x, point.y, 0);
    const { pose, plan, tags } = liveMap;
    const { sent, approach, draft, preview } = presented.current;
    const nowMs = viewNow();
    const sightings = shownSightings(liveMap.sightings, nowMs);
    const end = shownPlan(plan, pose, nowMs)?.left.at(-1);
    const [robotAt, endAt] = [pose === null ? null : toPixel(project(pose.x, pose.y, 0.15)), end === undefined ? null : toPixel(onFloor(end))];
    // Most frames only have a new scan: then every label is where it was.
    const view = [size.width, size.height, devicePixelRatio, textScale(), camera.zoom, ...camera.matrixWorld.elements];
    const content: unknown[] = [presented.current, tags, liveMap.sightings, sightings.length, robotAt?.x, robotAt?.y, endAt?.x, endAt?.y, ...view];
    if (content.every((each, index) => each === drawn.current[index])) return;
    const context = fitCanvas(canvas)?.context;
    if (context === undefined) return;
    drawn.current = content;
    context.clearRect(0, 0, size.width, size.height);
    const bloom = (flower: Flower): Point => {
      const { baseM, lengthM } = stemOf(flower);
      return project(flower.x, flower.y, baseM + lengthM);
    };
    drawBugs(context, bloom, tags, Math.max(9, 0.13 * camera.zoom));
    drawSightings(context, onFloor, sightings, sightingRadius(camera.zoom));
    for (const at of [sent, approach]) if (at !== null) drawFootprint(context, onFloor, camera.zoom, at);
    const obstacles = motionObstacles(robotAt, endAt);
    placesRef.current = drawTags(context, project, tags, { ...presented.current, textScale: textScale(), obstacles });
    if (draft !== null) drawDraft(context, onFloor, camera.zoom, draft, preview);
  });
  return null;
}

function toPixel({ x, y }: Point): Point {
  return { x: Math.round(x), y: Math.round(y) };
}
