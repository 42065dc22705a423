import { type KeyboardEvent, type PointerEvent, useRef } from "react";
import { cn } from "@/ui/cn";
import { fixed } from "@/ui/numbers";
import { type Joint, clampToWindow } from "./joints";

interface JointSliderProps {
  joint: Joint;
  label: string;
  /** What stands at the lower and the upper end. */
  ends: readonly [lower: string, upper: string];
  /** Where the thumb stands, degrees; undefined while nothing is known. */
  value: number | undefined;
  measured: number | undefined;
  /** The last command, drawn as a dashed ring. */
  commanded: number | undefined;
  disabled: boolean;
  onHold: (degrees: number) => void;
  onCommit: (degrees: number) => void;
  onAbandon: () => void;
}

/** A pointer that moved less than this was a touch, which moves nothing. */
const TOUCH_PX = 4;
const STEPS: Record<string, number> = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };

/**
 * The slider of a joint. It is dragged from where it stands and never jumps to the pointer, so that touching it moves nothing;
 * the angle is sent when it is let go.
 */
export function JointSlider({ joint, label, ends, value, measured, commanded, disabled, onHold, onCommit, onAbandon }: JointSliderProps) {
  const track = useRef<HTMLDivElement>(null);
  const drag = useRef<{ x: number; from: number; to: number | null } | null>(null);
  const range = joint.upperDeg - joint.lowerDeg;
  const percent = (degrees: number) => `${((clampToWindow(joint, degrees) - joint.lowerDeg) / range) * 100}%`;
  const canMove = !disabled && value !== undefined;

  function begin(event: PointerEvent<HTMLDivElement>): void {
    if (!canMove || event.button !== 0) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    drag.current = { x: event.clientX, from: value, to: null };
  }

  function follow(event: PointerEvent<HTMLDivElement>): void {
    const held = drag.current;
    const width = track.current?.clientWidth ?? 0;
    if (held === null || width === 0) return;
    const moved = event.clientX - held.x;
    if (held.to === null && Math.abs(moved) < TOUCH_PX) return;
    held.to = Math.round(clampToWindow(joint, held.from + (moved / width) * range));
    onHold(held.to);
  }

  function end(isSent: boolean): void {
    const held = drag.current;
    drag.current = null;
    if (held === null || held.to === null) return;
    // The page may have been stopped while the slider was held.
    if (isSent && canMove) onCommit(held.to);
    else onAbandon();
  }

  function onKeyDown(event: KeyboardEvent<HTMLDivElement>): void {
    const step = STEPS[event.key];
    if (step === undefined || !canMove) return;
    event.preventDefault();
    onCommit(Math.round(clampToWindow(joint, value + step)));
  }

  const zero = percent(0);
  return (
    <div
      role="slider"
      tabIndex={0}
      aria-label={label}
      aria-disabled={!canMove}
      aria-valuemin={joint.lowerDeg}
      aria-valuemax={joint.upperDeg}
      aria-valuenow={Math.round(value ?? 0)}
      aria-valuetext={`${fixed(value, 0)}°`}
      onPointerDown={begin}
      onPointerMove={follow}
      onPointerUp={() => end(true)}
      onPointerCancel={() => end(false)}
      onKeyDown={onKeyDown}
      className={cn("relative h-11 min-w-0 grow touch-none rounded-md select-none", canMove ? "cursor-grab active:cursor-grabbing" : "cursor-not-allowed")}
    >
      <div ref={track} className="absolute inset-x-3.5 top-1/2 h-1.5 -translate-y-1/2 rounded-full bg-raised outline outline-line">
        {measured !== undefined && (
          <span
            aria-hidden="true"
            className={cn("absolute inset-y-0 rounded-full", canMove ? "bg-sensed-2" : "bg-line-strong")}
            style={measured >= 0 ? { left: zero, right: `calc(100% - ${percent(measured)})` } : { left: percent(measured), right: `calc(100% - ${zero})` }}
          />
        )}
        <span aria-hidden="true" className="absolute -inset-y-1.5 w-px bg-line-strong" style={{ left: zero }} />
        {commanded !== undefined && (
          <span
            aria-hidden="true"
            className="absolute top-1/2 size-8 -translate-1/2 rounded-full border-2 border-dashed border-alive"
            style={{ left: percent(commanded) }}
          />
        )}
        {value !== undefined && (
          <span
            aria-hidden="true"
            className={cn("absolute top-1/2 size-6 -translate-1/2 rounded-full border-[5px] bg-panel", canMove ? "border-text" : "border-text-3")}
            style={{ left: percent(value) }}
          />
        )}
      </div>
      <span aria-hidden="true" className="pointer-events-none absolute inset-x-1 bottom-0 flex justify-between text-xs leading-none text-text-3 numeric">
        <span>{ends[0]}</span>
        <span>{ends[1]}</span>
      </span>
    </div>
  );
}
