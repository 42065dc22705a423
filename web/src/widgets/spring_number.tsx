import { useRef } from "react";
import { useSpring } from "@/motion/spring";
import { fixed } from "@/ui/numbers";

interface SpringNumberProps {
  value: number | null | undefined;
  places: number;
  /** Writes the number; with fixed places by default. */
  format?: (value: number, places: number) => string;
  /** Fixed-width figures of the mono font by default; large readings use those of the text font. */
  className?: string;
}

/** A slow value that rolls to its new reading. It writes its text itself: no render for every frame. */
export function SpringNumber({ value, places, format = fixed, className = "numeric" }: SpringNumberProps) {
  const element = useRef<HTMLSpanElement>(null);
  useSpring(value, (shown) => {
    if (element.current === null) return;
    const written = format(shown, places);
    if (element.current.textContent !== written) element.current.textContent = written;
  });
  return <span ref={element} className={className} />;
}
