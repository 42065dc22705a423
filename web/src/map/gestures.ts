/** Pointers on the map: one moves it or draws a pose, two zoom it, a tap chooses. */
import type { Point } from "./view";

export interface GestureTarget {
  /** Whether the pointer draws a pose instead of moving the map. */
  draws: () => boolean;
  pan: (pixels: Point) => void;
  zoom: (at: Point, factor: number) => void;
  tap: (at: Point) => void;
  draw: (start: Point, end: Point, phase: "move" | "end") => void;
  cancelDraw: () => void;
}

/** A drag shorter than this sets no heading. */
const SHORTEST_DRAG_PX = 14;
/** A pointer that moved less than this was a tap. */
const TAP_PX = 5;
const WHEEL_STEP = 0.0016;

/** Pure but for its events: it keeps which pointers are down, and tells the target what they mean. */
export class Gestures {
  private pointers = new Map<number, Point>();
  private start: Point | null = null;
  private isDrawing = false;
  private moved = false;

  constructor(private readonly target: GestureTarget) {}

  down(id: number, at: Point, isPrimaryButton: boolean): void {
    this.pointers.set(id, at);
    if (this.pointers.size === 1) {
      this.start = at;
      this.moved = false;
      this.isDrawing = isPrimaryButton && this.target.draws();
      if (this.isDrawing) this.target.draw(at, at, "move");
      return;
    }
    // A second finger means the map, not the pose.
    if (this.isDrawing) this.target.cancelDraw();
    this.isDrawing = false;
    this.moved = true;
  }

  move(id: number, at: Point): void {
    const before = this.pointers.get(id);
    if (before === undefined || this.start === null) return;
    const [spreadBefore, middleBefore] = this.spread();
    this.pointers.set(id, at);
    if (this.pointers.size >= 2) {
      const [spread, middle] = this.spread();
      this.target.pan({ x: middle.x - middleBefore.x, y: middle.y - middleBefore.y });
      if (spreadBefore > 0) this.target.zoom(middle, spread / spreadBefore);
      return;
    }
    const distance = Math.hypot(at.x - this.start.x, at.y - this.start.y);
    if (this.isDrawing) {
      this.target.draw(this.start, at, "move");
    } else if (this.moved || distance > TAP_PX) {
      this.target.pan({ x: at.x - (this.moved ? before.x : this.start.x), y: at.y - (this.moved ? before.y : this.start.y) });
      this.moved = true;
    }
  }

  up(id: number, at: Point): void {
    if (!this.pointers.delete(id) || this.start === null) return;
    if (this.pointers.size > 0) return;
    if (this.isDrawing) this.target.draw(this.start, at, "end");
    else if (!this.moved) this.target.tap(at);
    this.reset();
  }

  cancel(): void {
    if (this.isDrawing) this.target.cancelDraw();
    this.pointers.clear();
    this.reset();
  }

  wheel(at: Point, delta: number): void {
    this.target.zoom(at, Math.exp(-delta * WHEEL_STEP));
  }

  private reset(): void {
    this.start = null;
    this.isDrawing = false;
  }

  /** The distance of the first two pointers, and the point between them. */
  private spread(): [number, Point] {
    const [a, b] = [...this.pointers.values()];
    if (a === undefined) return [0, { x: 0, y: 0 }];
    if (b === undefined) return [0, a];
    return [Math.hypot(a.x - b.x, a.y - b.y), { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 }];
  }
}

/** Whether a drag is long enough to give a heading. */
export function setsHeading(start: Point, end: Point): boolean {
  return Math.hypot(end.x - start.x, end.y - start.y) >= SHORTEST_DRAG_PX;
}
