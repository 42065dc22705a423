/** Draws the map from above on a canvas, only when something changed, and once per frame at most. */
import { fitCanvas } from "@/widgets/canvas";
import { drawDraft, drawMotion, drawRobot, drawFootprint } from "./draw/motion";
import { SceneDrawing } from "./draw/scene";
import { textScale } from "./draw/ink";
import { drawFlowers, drawSightings, drawTags, motionObstacles, sightingRadius } from "./draw/tags";
import type { Sensor } from "./health";
import { type Rectangle, hitLabel } from "./labels";
import { type LiveMap, SCAN_STALE_MS } from "./live_map";
import type { Draft, Preview } from "./map_ui";
import { shownPlan } from "./route";
import { shownSightings } from "./sightings";
import type { Pose2 } from "@/ros/tf";
import { type Bounds, type Margins, type Point, type Size, type View, boundsOf, fit, grow, panBy, toScreen, toWorld, union, zoomAt } from "./view";
import { viewNow } from "@/hooks/view_clock";

/** What is drawn beside the data: what the operator chose, and how the robot fares. */
export interface Presentation {
  layer: Sensor | null;
  isFollowing: boolean;
  draft: Draft | null;
  preview: Preview | null;
  sent: Pose2 | null;
  /** The stored approach of the selected tag. */
  approach: Pose2 | null;
  selected: string | null;
  current: string;
  isStopped: boolean;
  isPoseStale: boolean;
  turned: boolean;
  isSmall: boolean;
}

const NOTHING: Presentation = {
  layer: null,
  isFollowing: false,
  draft: null,
  preview: null,
  sent: null,
  approach: null,
  selected: null,
  current: "",
  isStopped: false,
  isPoseStale: false,
  turned: false,
  isSmall: false,
};

/** Shown before there is a map. */
const EMPTY: Bounds = { minX: -2, minY: -2, maxX: 2, maxY: 2 };

export class MapRenderer {
  view: View = { x: 0, y: 0, scale: 50, turned: false };
  /** Whether the view follows the map as it grows; ends when the operator moves it. */
  isFitted = true;
  margins: Margins = { top: 0, right: 0, bottom: 0, left: 0 };
  /** Where the labels were drawn last. */
  labels: ReadonlyMap<string, Rectangle> = new Map();

  private shown = NOTHING;
  private readonly scene = new SceneDrawing();
  private readonly background = document.createElement("canvas");
  private isSceneOld = true;
  private frame = 0;
  private readonly ends: (() => void)[];

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly live: LiveMap,
    private readonly viewChanged: (view: View) => void,
  ) {
    const observer = new ResizeObserver(() => this.redraw(true));
    observer.observe(canvas);
    this.ends = [live.listen((change) => change !== "joints" && this.redraw(change === "scene")), () => observer.disconnect()];
  }

  close(): void {
    cancelAnimationFrame(this.frame);
    for (const end of this.ends) end();
  }

  get size(): Size {
    return { width: this.canvas.clientWidth, height: this.canvas.clientHeight };
  }

  present(shown: Presentation): void {
    if (shown.turned !== this.shown.turned) this.view = { ...this.view, turned: shown.turned };
    this.shown = shown;
    this.redraw(true);
  }

  fit(): void {
    this.isFitted = true;
    this.redraw(true);
  }

  zoom(factor: number, at: Point = { x: this.size.width / 2, y: this.size.height / 2 }): void {
    this.isFitted = false;
    this.view = zoomAt(this.view, this.size, at, factor);
    this.redraw(true);
  }

  pan(pixels: Point): void {
    this.isFitted = false;
    this.view = panBy(this.view, pixels);
    this.redraw(true);
  }

  center(): Point {
    return { x: this.view.x, y: this.view.y };
  }

  get turned(): boolean {
    return this.view.turned;
  }

  toWorld(pixel: Point): Point {
    return toWorld(this.view, this.size, pixel);
  }

  /** The tag whose label is at a pixel. */
  tagAt(pixel: Point): string | null {
    return hitLabel(this.labels, pixel);
  }

  private redraw(scene: boolean): void {
    this.isSceneOld ||= scene;
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this.draw();
    });
  }

  private place(size: Size): void {
    const before = this.view;
    const { pose, grid } = this.live;
    if (this.isFitted) {
      const around = pose === null ? null : grow(boundsOf([pose]) ?? EMPTY, grid === null ? 2 : 0.4);
      this.view = fit(union(grid?.bounds ?? null, around) ?? EMPTY, size, this.margins, this.shown.turned);
    }
    if (this.shown.isFollowing && pose !== null) this.view = { ...this.view, x: pose.x, y: pose.y };
    const isMoved = before.x !== this.view.x || before.y !== this.view.y || before.scale !== this.view.scale;
    if (isMoved) this.isSceneOld = true;
    this.viewChanged(this.view);
  }

  private draw(): void {
    const drawing = fitCanvas(this.canvas);
    if (drawing === null) return;
    const { context, width, height } = drawing;
    const size = { width, height };
    this.place(size);
    this.updateBackground(size);
    context.clearRect(0, 0, width, height);
    context.drawImage(this.background, 0, 0, width, height);
    const nowMs = viewNow();
    const { live, shown, view } = this;
    const isScanStale = live.scan === null || nowMs - live.scan.receivedMs > SCAN_STALE_MS || shown.isPoseStale;
    const style = { isStopped: shown.isStopped, isPoseStale: shown.isPoseStale, isScanStale, nowMs };
    drawMotion(context, view, size, live, style);
    const projectPoint = (point: Point): Point => toScreen(view, size, point);
    const project = (x: number, y: number): Point => projectPoint({ x, y });
    drawFlowers(context, project, live.tags, view.scale);
    drawSightings(context, projectPoint, shownSightings(live.sightings, nowMs), sightingRadius(view.scale));
    for (const pose of [shown.sent, shown.approach]) if (pose !== null) drawFootprint(context, projectPoint, view.scale, pose);
    if (live.pose !== null) drawRobot(context, view, size, live.pose, style);
    const plan = shownPlan(live.plan, live.pose, nowMs);
    const obstacles = motionObstacles(live.pose === null ? null : projectPoint(live.pose), plan === null ? null : projectPoint(plan.left.at(-1) ?? view));
    this.labels = drawTags(context, project, live.tags, { ...shown, textScale: textScale(), obstacles });
    if (shown.draft !== null) drawDraft(context, projectPoint, view.scale, shown.draft, shown.preview);
  }

  /** What stands still is drawn to a canvas of its own, which is copied in every frame. */
  private updateBackground(size: Size): void {
    const { background, canvas } = this;
    if (!this.isSceneOld && background.width === canvas.width && background.height === canvas.height) return;
    if (background.width !== canvas.width || background.height !== canvas.height) {
      background.width = canvas.width;
      background.height = canvas.height;
    }
    const context = background.getContext("2d");
    if (context === null) return;
    const ratio = canvas.width / size.width;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, size.width, size.height);
    this.scene.draw(context, this.view, size, this.live);
    this.isSceneOld = false;
  }
}
