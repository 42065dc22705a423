/** Labels and drawn poses over the scene, on a canvas of their own: text stays sharp and upright. */
import { useFrame, useThree } from "@react-three/fiber";
import { type RefObject, useEffect, useRef } from "react";
import type { OrthographicCamera } from "three";
import { drawDraft, drawSentGoal } from "@/map/draw/motion";
import { textScale } from "@/map/draw/ink";
import { drawBugs, drawTags, motionObstacles } from "@/map/draw/tags";
import type { Rectangle } from "@/map/labels";
import { liveMap } from "@/map/live_map";
import type { Presentation } from "@/map/renderer";
import { shownPlan } from "@/map/route";
import type { Flower } from "@/map/twin";
import type { Point } from "@/map/view";
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
  useFrame(() => {
    const drawing = overlayRef.current === null ? null : fitCanvas(overlayRef.current);
    if (drawing === null) return;
    const { context, width, height } = drawing;
    const size = { width, height };
    context.clearRect(0, 0, width, height);
    const project = (x: number, y: number, z: number): Point => projectPoint(camera, size, x, y, z);
    const onFloor = (point: Point): Point => project(point.x, point.y, 0);
    const { pose, plan, tags } = liveMap;
    const { sent, draft, preview } = presented.current;
    const bloom = (flower: Flower): Point => {
      const { baseM, lengthM } = stemOf(flower);
      return project(flower.x, flower.y, baseM + lengthM);
    };
    drawBugs(context, bloom, tags, Math.max(9, 0.13 * camera.zoom));
    if (sent !== null) drawSentGoal(context, onFloor, camera.zoom, sent);
    const end = shownPlan(plan, pose, performance.now())?.left.at(-1);
    const obstacles = motionObstacles(pose === null ? null : project(pose.x, pose.y, 0.15), end === undefined ? null : onFloor(end));
    placesRef.current = drawTags(context, project, tags, { ...presented.current, textScale: textScale(), obstacles });
    if (draft !== null) drawDraft(context, onFloor, camera.zoom, draft, preview);
  });
  return null;
}
