import { type KeyboardEvent, type PointerEvent, useRef } from "react";
import { cn } from "@/ui/cn";
import { fixed } from "@/ui/numbers";
import { type Joint, clampToLimits } from "./joints";

interface JointSliderProps {
  joint: Joint;
  label: string;
  /** Labels of the lower and the upper end. */
  endLabels: readonly [lower: string, upper: string];
  /** Position of the thumb: the angle that is being dragged or was sent, otherwise the measured one; undefined while unknown. */
  thumbDeg: number | undefined;
  /** Measured angle, drawn as a bar from zero. */
  measuredDeg: number | undefined;
  /** Last command, drawn as a dashed ring. */
  commandedDeg: number | undefined;
  disabled: boolean;
  onDrag: (degrees: number) => void;
  /** Called once with the final angle, which is to be sent. */
  onCommit: (degrees: number) => void;
  onCancel: () => void;
}

/** Pointer travel below which a press is no drag. */
const DRAG_THRESHOLD_PX = 4;
const STEPS: Record<string, number> = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };

/**
 * The slider of a joint. Dragging is relative: the thumb moves by as much as the pointer does, so that a press alone moves
 * nothing. The angle is sent on release.
 */
export function JointSlider({
  joint,
  label,
  endLabels,
  thumbDeg,
  measuredDeg,
  commandedDeg,
  disabled,
  onDrag,
  onCommit,
  onCancel,
}: JointSliderProps) {
  const track = useRef<HTMLDivElement>(null);
  const drag = useRef<{ x: number; from: number; to: number | null } | null>(null);
  const range = joint.upperDeg - joint.lowerDeg;
  const percent = (degrees: number) => `${((clampToLimits(joint, degrees) - joint.lowerDeg) / range) * 100}%`;
  const canMove = !disabled && thumbDeg !== undefined;

  function begin(event: PointerEvent<HTMLDivElement>): void {
    if (!canMove || event.button !== 0) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    drag.current = { x: event.clientX, from: thumbDeg, to: null };
  }

  function follow(event: PointerEvent<HTMLDivElement>): void {
    const held = drag.current;
    const width = track.current?.clientWidth ?? 0;
    if (held === null || width === 0) return;
    const moved = event.clientX - held.x;
    if (held.to === null && Math.abs(moved) < DRAG_THRESHOLD_PX) return;
    held.to = Math.round(clampToLimits(joint, held.from + (moved / width) * range));
    onDrag(held.to);
  }

  function end(commit: boolean): void {
    const held = drag.current;
    drag.current = null;
    if (held === null || held.to === null) return;
    // Control may be lost, or the robot stopped, during a drag.
    if (commit && canMove) onCommit(held.to);
    else onCancel();
  }

  function onKeyDown(event: KeyboardEvent<HTMLDivElement>): void {
    const step = STEPS[event.key];
    if (step === undefined || !canMove) return;
    event.preventDefault();
    onCommit(Math.round(clampToLimits(joint, thumbDeg + step)));
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
      aria-valuenow={Math.round(thumbDeg ?? 0)}
      aria-valuetext={`${fixed(thumbDeg, 0)}°`}
      onPointerDown={begin}
      onPointerMove={follow}
      onPointerUp={() => end(true)}
      onPointerCancel={() => end(false)}
      onKeyDown={onKeyDown}
      className={cn("relative h-11 min-w-0 grow touch-none rounded-md select-none", canMove ? "cursor-grab active:cursor-grabbing" : "cursor-not-allowed")}
    >
      <div ref={track} className="absolute inset-x-3.5 top-1/2 h-1.5 -translate-y-1/2 rounded-full bg-raised outline outline-line">
        {measuredDeg !== undefined && (
          <span
            aria-hidden="true"
            className={cn("absolute inset-y-0 rounded-full", canMove ? "bg-sensed-2" : "bg-line-strong")}
            style={measuredDeg >= 0 ? { left: zero, right: `calc(100% - ${percent(measuredDeg)})` } : { left: percent(measuredDeg), right: `calc(100% - ${zero})` }}
          />
        )}
        <span aria-hidden="true" className="absolute -inset-y-1.5 w-px bg-line-strong" style={{ left: zero }} />
        {commandedDeg !== undefined && (
          <span
            aria-hidden="true"
            className="absolute top-1/2 size-8 -translate-1/2 rounded-full border-2 border-dashed border-alive"
            style={{ left: percent(commandedDeg) }}
          />
        )}
        {thumbDeg !== undefined && (
          <span
            aria-hidden="true"
            className={cn("absolute top-1/2 size-6 -translate-1/2 rounded-full border-[5px] bg-panel", canMove ? "border-text" : "border-text-3")}
            style={{ left: percent(thumbDeg) }}
          />
        )}
      </div>
      <span aria-hidden="true" className="pointer-events-none absolute inset-x-1 bottom-0 flex justify-between text-xs leading-none text-text-3 numeric">
        <span>{endLabels[0]}</span>
        <span>{endLabels[1]}</span>
      </span>
    </div>
  );
}
