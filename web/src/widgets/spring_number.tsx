import { useEffect, useRef } from "react";
import { useSpring } from "@/motion/spring";
import { fixed } from "@/ui/numbers";

interface SpringNumberProps {
  value: number | null | undefined;
  places: number;
  /** Writes the number; with fixed places by default. */
  format?: (value: number, places: number) => string;
  /** Fixed-width figures of the mono font by default; large readings use those of the text font. */
  className?: string;
  /** It flashes with each change by so much; without this, it never does. */
  flashFrom?: number;
}

/** A slow value that rolls to its new reading. It writes its text itself: no render for every frame. */
export function SpringNumber({ value, places, format = fixed, className = "numeric", flashFrom = Infinity }: SpringNumberProps) {
  const element = useRef<HTMLSpanElement>(null);
  const flashed = useRef<number | null>(null);
  useEffect(() => {
    if (value === null || value === undefined || !Number.isFinite(value)) return;
    const before = flashed.current;
    if (before !== null && Math.abs(value - before) < flashFrom) return;
    flashed.current = value;
    if (before === null || element.current === null) return;
    // Another animation of the same look, so that each change begins it anew.
    element.current.dataset["flash"] = element.current.dataset["flash"] === "a" ? "b" : "a";
  }, [value, flashFrom]);
  useSpring(value, (shown) => {
    if (element.current === null) return;
    const written = format(shown, places);
    if (element.current.textContent !== written) element.current.textContent = written;
  });
  return <span ref={element} className={className} />;
}
