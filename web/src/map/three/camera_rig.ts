/** Moves the camera of the view in 3D: as the operator drags it, as the map grows, or with the robot. */
import { type OrthographicCamera, Vector3 } from "three";
import { MapControls } from "three/examples/jsm/controls/MapControls.js";
import type { KeyTarget } from "@/map/map_keys";
import type { LiveMap } from "@/map/live_map";
import { type Bounds, type Margins, type Point, type Size, type View, boundsOf, grow, union } from "@/map/view";
import { ZOOM_LIMITS, fitCamera, floorBelow } from "./camera";
import { WALL_M } from "./walls";

/** How flat the view may become, from straight above. */
const LOWEST_RAD = 1.35;
/** Shown before there is a map. */
const EMPTY: Bounds = { minX: -2, minY: -2, maxX: 2, maxY: 2 };

export interface CameraListener {
  /** The camera moved: the next frame is wanted, at once where the operator moved it. */
  moved: (view: View, byOperator: boolean) => void;
  /** The operator moved it by hand. */
  taken: () => void;
}

export class CameraRig implements KeyTarget {
  turned = false;
  isFollowing = false;
  private isFitted = true;
  private hasSeenRobot = false;
  private isMovedByOperator = true;
  private size: Size = { width: 1, height: 1 };
  private margins: Margins = { top: 0, right: 0, bottom: 0, left: 0 };
  private readonly controls: MapControls;
  private readonly end: () => void;

  constructor(
    private readonly camera: OrthographicCamera,
    element: HTMLElement,
    private readonly live: LiveMap,
    private readonly listener: CameraListener,
  ) {
    this.controls = new MapControls(camera, element);
    this.controls.enableDamping = false;
    this.controls.zoomToCursor = true;
    this.controls.minZoom = ZOOM_LIMITS.low;
    this.controls.maxZoom = ZOOM_LIMITS.high;
    this.controls.maxPolarAngle = LOWEST_RAD;
    this.controls.addEventListener("change", () => this.report(this.isMovedByOperator));
    this.controls.addEventListener("start", () => {
      this.isFitted = false;
      this.listener.taken();
    });
    this.end = live.listen((change) => {
      if (change === "scene" && this.isFitted) this.placeForAll(false);
      if (change === "motion") this.robotMoved();
    });
  }

  close(): void {
    this.end();
    this.controls.dispose();
  }

  /** Fit the place where the scene is shown. */
  resize(size: Size, margins: Margins, turned: boolean): void {
    this.size = size;
    this.margins = margins;
    this.turned = turned;
    if (this.isFitted) this.placeForAll(true);
  }

  /** Whether pointers move the camera, or are needed to draw. */
  setEnabled(enabled: boolean): void {
    this.controls.enabled = enabled;
  }

  setFollowing(isFollowing: boolean): void {
    this.isFollowing = isFollowing;
    this.robotMoved();
  }

  fit(): void {
    this.isFitted = true;
    this.placeForAll(true);
  }

  pan(pixels: Point): void {
    this.isFitted = false;
    const right = new Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0);
    const ahead = new Vector3(-right.y, right.x, 0);
    this.moveBy(right.multiplyScalar(-pixels.x / this.camera.zoom).addScaledVector(ahead, pixels.y / this.camera.zoom), true);
  }

  zoom(factor: number): void {
    this.isFitted = false;
    this.camera.zoom = Math.min(ZOOM_LIMITS.high, Math.max(ZOOM_LIMITS.low, this.camera.zoom * factor));
    this.camera.updateProjectionMatrix();
    this.report(true);
  }

  center(): Point {
    return { x: this.controls.target.x, y: this.controls.target.y };
  }

  toWorld(pixel: Point): Point | null {
    return floorBelow(this.camera, this.size, pixel);
  }

  private placeForAll(byOperator: boolean): void {
    const around = this.live.pose === null ? null : boundsOf([this.live.pose]);
    const bounds = union(this.live.grid?.bounds ?? null, around === null ? null : grow(around, 0.4)) ?? EMPTY;
    this.controls.target.copy(fitCamera(this.camera, bounds, WALL_M, this.size, this.margins, this.turned));
    this.report(byOperator);
  }

  private robotMoved(): void {
    const { pose } = this.live;
    if (pose === null) return;
    if (!this.hasSeenRobot && this.isFitted) this.placeForAll(false);
    this.hasSeenRobot = true;
    if (!this.isFollowing) return;
    this.isFitted = false;
    this.moveBy(new Vector3(pose.x, pose.y, 0).sub(this.controls.target), false);
  }

  private moveBy(shift: Vector3, byOperator: boolean): void {
    this.camera.position.add(shift);
    this.controls.target.add(shift);
    this.isMovedByOperator = byOperator;
    this.controls.update();
    this.isMovedByOperator = true;
    this.report(byOperator);
  }

  private report(byOperator: boolean): void {
    const { x, y } = this.controls.target;
    this.listener.moved({ x, y, scale: this.camera.zoom, turned: this.turned }, byOperator);
  }
}
