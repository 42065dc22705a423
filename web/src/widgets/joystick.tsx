import { type PointerEvent, useEffect, useRef, useState } from "react";
import { cn } from "@/ui/cn";

interface JoystickProps {
  label: string;
  /** Only left and right. */
  horizontal?: boolean;
  disabled: boolean;
  /** Where other inputs, such as keys, hold the stick: -1..1 to the right and upwards. */
  shown?: { right: number; up: number };
  /** -1..1 to the right and upwards; 0, 0 when it is let go. */
  onMove: (right: number, up: number) => void;
  className?: string;
}

const DEAD_ZONE = 0.06;
const REST = { right: 0, up: 0 };

/** A stick that springs back. It is moved by the pointer, and shows what other inputs do. */
export function Joystick({ label, horizontal = false, disabled, shown = REST, onMove, className }: JoystickProps) {
  const pad = useRef<HTMLDivElement>(null);
  const [offset, setOffset] = useState({ x: 0, y: 0 });
  const [held, setHeld] = useState(false);

  const move = useRef(onMove);
  useEffect(() => {
    move.current = onMove;
  });
  if (held && disabled) {
    setHeld(false);
    setOffset({ x: 0, y: 0 });
  }
  // However the hold ends: no event says that a stick left the page, or may not be used any more.
  useEffect(() => (held ? () => move.current(0, 0) : undefined), [held]);

  function follow(event: PointerEvent<HTMLDivElement>): void {
    const area = pad.current?.getBoundingClientRect();
    if (area === undefined) return;
    const reach = area.width * 0.36;
    let x = (event.clientX - area.left - area.width / 2) / reach;
    let y = horizontal ? 0 : (event.clientY - area.top - area.height / 2) / reach;
    const length = Math.hypot(x, y);
    if (length > 1) {
      x /= length;
      y /= length;
    }
    setOffset({ x, y });
    onMove(shaped(x), -shaped(y));
  }

  function letGo(): void {
    setHeld(false);
    setOffset({ x: 0, y: 0 });
    onMove(0, 0);
  }

  const knob = held || disabled ? offset : { x: shown.right, y: -shown.up };
  return (
    <div
      ref={pad}
      role="application"
      aria-label={label}
      aria-disabled={disabled}
      onPointerDown={(event) => {
        if (disabled || event.button !== 0) return;
        event.currentTarget.setPointerCapture(event.pointerId);
        setHeld(true);
        follow(event);
      }}
      onPointerMove={(event) => held && follow(event)}
      onPointerUp={letGo}
      onPointerCancel={letGo}
      onLostPointerCapture={letGo}
      onContextMenu={(event) => event.preventDefault()}
      className={cn(
        "relative aspect-square touch-none rounded-full border-8 border-panel/80 bg-void/85 select-none",
        "before:absolute before:inset-0 before:rounded-full before:border before:border-line-strong",
        className,
      )}
    >
      {!horizontal && <span aria-hidden="true" className="absolute inset-y-[12%] left-1/2 w-px bg-line-strong" />}
      <span aria-hidden="true" className="absolute inset-x-[12%] top-1/2 h-px bg-line-strong" />
      <span
        aria-hidden="true"
        className={cn("absolute top-1/2 left-1/2 size-[34%] rounded-full", disabled ? "bg-text-3" : "bg-alive", !held && "transition-transform duration-150")}
        style={{ transform: `translate(calc(-50% + ${knob.x * 106}%), calc(-50% + ${knob.y * 106}%))` }}
      />
      <span aria-hidden="true" className="absolute inset-x-0 bottom-[9%] text-center text-sm text-text-2">
        {label}
      </span>
    </div>
  );
}

function shaped(value: number): number {
  const size = Math.abs(value);
  return size < DEAD_ZONE ? 0 : (Math.sign(value) * (size - DEAD_ZONE)) / (1 - DEAD_ZONE);
}
