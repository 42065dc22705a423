/**
 * What is known of the map now, for both views of it. Samples come far more often than the page renders, so that views listen
 * here and draw, without React.
 */
import { FRAMES } from "@/generated/graph";
import type { lupin_msgs_Observation, nav_msgs_OccupancyGrid, nav_msgs_Odometry, nav_msgs_Path, sensor_msgs_LaserScan, tf2_msgs_TFMessage } from "@/generated/messages";
import { MODEL_MOUNT, echoesOf, mountOf } from "@/ros/scan";
import { type Pose2, TransformTree, compose, frameName, hasMoved } from "@/ros/tf";
import type { Box } from "./boxes";
import { type Grid, classify, isSameGrid, knownBounds, readGrid } from "./grid";
import type { Field } from "./heat";
import { PoseHistory } from "./pose_history";
import { Trail, readPath } from "./route";
import { SIGHTING_MS, type Sighting, addSighting, placeOf } from "./sightings";
import type { Tag } from "./twin";
import type { Bounds, Point } from "./view";

/** Without a transform for so long, the robot's place is out of date. */
export const POSE_STALE_MS = 2000;
/** Without a transform from the map for so long, nothing says any more where the robot is: the localization is gone, or lost it. */
const UNPLACED_MS = 5000;
export const SCAN_STALE_MS = 1500;
/** Samples of one transform that come in the wrong order differ by less than this; more is a clock that was set back. */
const LATE_S = 1;

export interface ShownGrid {
  grid: Grid;
  kinds: Uint8Array;
  bounds: Bounds | null;
  /** Grows with every change, for what is built from the grid. */
  version: number;
  receivedMs: number;
}

/** `scene`: what stands still. `motion`: the robot, its scan, plan and trail. `joints`: its arm and wheels. */
export type Change = "scene" | "motion" | "joints";
type Listener = (change: Change) => void;

export class LiveMap {
  grid: ShownGrid | null = null;
  /** The robot in the map, as it was last drawn. */
  pose: Pose2 | null = null;
  /** performance.now() of the last transform of the robot; null before the first. */
  poseReceivedMs: number | null = null;
  /** m/s over the ground, from the odometry. */
  speedMps: number | null = null;
  trail = new Trail();
  plan: { points: Point[]; receivedMs: number } | null = null;
  /** Echoes in the map: x and y of each, and the place from which they were measured. */
  scan: { echoes: Float32Array; from: Point; receivedMs: number } | null = null;
  tags: Tag[] = [];
  twinReceivedMs: number | null = null;
  boxes: Box[] = [];
  sightings: readonly Sighting[] = [];
  field: Field | null = null;
  /** Positions of the joints by name, rad, and when they came. */
  joints: Map<string, number> = new Map();
  jointsReceivedMs: number | null = null;

  private gridVersion = 0;
  private trailOfNow: Trail | null = null;
  private frames: { map: string; base: string } = { map: FRAMES.map, base: FRAMES.base };
  private listeners = new Set<Listener>();
  private tree = new TransformTree();
  private history = new PoseHistory();
  private stamps = new Map<string, number>();
  /** When the last transform from the map came; Infinity if it is static. */
  private placedMs = -Infinity;
  private sightingTimer: ReturnType<typeof setTimeout> | undefined;
  private waitingScan: { message: sensor_msgs_LaserScan; receivedMs: number } | null = null;

  /** Call `listener` with every change until the returned function is called. */
  listen(listener: Listener): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  notify(change: Change): void {
    for (const listener of this.listeners) listener(change);
  }

  /** Show the robot's frame `base` in the frame `map`. */
  follow(map: string, base: string): void {
    if (map !== this.frames.map || base !== this.frames.base) this.forgetTransforms();
    this.frames = { map, base };
  }

  takeGrid(message: nav_msgs_OccupancyGrid, receivedMs: number): void {
    const grid = readGrid(message);
    if (grid === null) return;
    if (isSameGrid(this.grid?.grid ?? null, grid) && this.grid !== null) {
      this.grid.receivedMs = receivedMs;
      return;
    }
    const kinds = classify(grid);
    this.gridVersion += 1;
    this.grid = { grid, kinds, bounds: knownBounds(grid, kinds), version: this.gridVersion, receivedMs };
    this.notify("scene");
  }

  takeTransforms(message: tf2_msgs_TFMessage, receivedMs: number): void {
    this.update(message.transforms, receivedMs);
  }

  takeStaticTransforms(message: tf2_msgs_TFMessage, receivedMs: number): void {
    if (message.transforms.some((each) => this.isFromMap(each))) this.placedMs = Infinity;
    this.update(message.transforms, receivedMs);
  }

  private isFromMap({ header }: tf2_msgs_TFMessage["transforms"][number]): boolean {
    return frameName(header.frame_id) === frameName(this.frames.map);
  }

  /**
   * Odometry is the robot's transform, too. The server passes one message of /tf in 100 ms, of whichever node it comes: without
   * this, the robot would jump where the others win.
   */
  takeOdometry(message: nav_msgs_Odometry, receivedMs: number): void {
    const { x, y } = message.twist.twist.linear;
    this.speedMps = Number.isFinite(x) && Number.isFinite(y) ? Math.hypot(x, y) : null;
    const { position, orientation } = message.pose.pose;
    const transform = { translation: position, rotation: orientation };
    this.update([{ header: message.header, child_frame_id: message.child_frame_id, transform }], receivedMs);
  }

  private update(transforms: tf2_msgs_TFMessage["transforms"], receivedMs: number): void {
    const isNew = ({ header, child_frame_id }: (typeof transforms)[number]) => {
      const stampS = header.stamp.sec + header.stamp.nanosec / 1e9;
      const lateS = (this.stamps.get(child_frame_id) ?? -Infinity) - stampS;
      if (lateS > 0 && lateS < LATE_S) return false;
      this.stamps.set(child_frame_id, stampS);
      return true;
    };
    const newer = transforms.filter(isNew);
    this.tree.update({ transforms: newer });
    if (newer.some((each) => this.isFromMap(each))) this.placedMs = Math.max(this.placedMs, receivedMs);
    if (receivedMs - this.placedMs > UNPLACED_MS) return;
    const pose = this.tree.lookUp(this.frames.map, this.frames.base);
    if (pose === null) return;
    const own = newer.find((each) => frameName(each.child_frame_id) === frameName(this.frames.base));
    if (own !== undefined) {
      this.poseReceivedMs = receivedMs;
      this.history.add(own.header.stamp.sec + own.header.stamp.nanosec / 1e9, pose);
      if (this.waitingScan !== null) this.placeScan(this.waitingScan.message, this.waitingScan.receivedMs);
    }
    if (!hasMoved(this.pose, pose)) return;
    this.pose = pose;
    this.trail.add(pose, receivedMs);
    this.notify("motion");
  }

  takeScan(message: sensor_msgs_LaserScan, receivedMs: number): void {
    this.placeScan(message, receivedMs);
  }

  /** Place a scan where it was taken; it waits for the next pose where that is newer than all that are known. */
  private placeScan(message: sensor_msgs_LaserScan, receivedMs: number): void {
    const stampS = message.header.stamp.sec + message.header.stamp.nanosec / 1e9;
    const newest = this.history.newestS;
    if (newest === null) return;
    const isFuture = stampS > newest && stampS < newest + LATE_S;
    this.waitingScan = isFuture ? { message, receivedMs } : null;
    if (isFuture) return;
    const base = this.history.at(stampS) ?? this.pose;
    if (base === null) return;
    const known = this.tree.transform(this.frames.base, message.header.frame_id);
    const mount = known === null ? MODEL_MOUNT : mountOf(known);
    if (mount === null) return;
    const lidar = { ...compose(base, mount), upsideDown: mount.upsideDown };
    this.scan = { echoes: echoesOf(message, lidar), from: { x: lidar.x, y: lidar.y }, receivedMs };
    this.notify("motion");
  }

  takePlan(message: nav_msgs_Path, receivedMs: number): void {
    this.plan = { points: readPath(message), receivedMs };
    this.notify("motion");
  }

  takeJoints(names: readonly string[], positions: ArrayLike<number>, receivedMs: number): void {
    names.forEach((name, index) => {
      const position = positions[index];
      if (position !== undefined && Number.isFinite(position)) this.joints.set(name, position);
    });
    this.jointsReceivedMs = receivedMs;
    this.notify("joints");
  }

  takeTags(tags: Tag[], receivedMs: number): void {
    this.tags = tags;
    this.twinReceivedMs = receivedMs;
    this.notify("scene");
  }

  /** Show an observation for some seconds. Of a late subscriber, latched ones of the past are passed over. */
  takeObservation(observation: lupin_msgs_Observation, receivedMs: number): void {
    const place = placeOf(observation);
    const { sec, nanosec } = observation.header.stamp;
    const ageS = (this.history.newestS ?? Infinity) - sec - nanosec / 1e9;
    if (place === null || ageS > SIGHTING_MS / 1000) return;
    this.sightings = addSighting(this.sightings, { ...place, receivedMs });
    this.notify("motion");
    // Without this, the last one would stay until something else moves.
    clearTimeout(this.sightingTimer);
    this.sightingTimer = setTimeout(() => this.notify("motion"), SIGHTING_MS + 1);
  }

  takeBoxes(boxes: Box[]): void {
    this.boxes = boxes;
    this.notify("scene");
  }

  takeField(field: Field | null): void {
    this.field = field;
    this.notify("scene");
  }

  /** Forget where frames were, as when nothing listens to them any more. */
  forgetTransforms(): void {
    this.tree.clear();
    this.history.clear();
    this.stamps.clear();
    this.placedMs = -Infinity;
    this.pose = null;
    this.poseReceivedMs = null;
    this.waitingScan = null;
  }

  /** Forget all that was received, for samples of another time. */
  forget(): void {
    this.forgetTransforms();
    this.trail = new Trail();
    this.grid = this.speedMps = this.plan = this.scan = this.twinReceivedMs = this.field = this.jointsReceivedMs = null;
    this.tags = [];
    this.boxes = [];
    this.sightings = [];
    this.joints = new Map();
    this.notify("scene");
    this.notify("motion");
    this.notify("joints");
  }

  /** Show another time than now: the trail of now is kept until `takeUp`. */
  setAside(): void {
    this.trailOfNow ??= this.trail;
    this.forget();
  }

  /** Show now again. */
  takeUp(): void {
    this.forget();
    this.trail = this.trailOfNow ?? this.trail;
    this.trailOfNow = null;
  }
}

/** The one map of this page: the trail goes on when another tab is shown in between. */
export const liveMap = new LiveMap();
