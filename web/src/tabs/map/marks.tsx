import type { HealthState } from "@/map/health";
import { HEALTH_COLORS, STEM_COLOR, speciesColor } from "@/map/species";
import { cn } from "@/ui/cn";

/** The shape of a state of health, as on the map: disc, outline of a triangle, triangle, square, ring. */
export function HealthMark({ state, className }: { state: HealthState; className?: string }) {
  const color = HEALTH_COLORS[state];
  return (
    <svg aria-hidden="true" viewBox="0 0 12 12" className={cn("size-3 shrink-0", className)}>
      {state === "healthy" && <circle cx="6" cy="6" r="5" fill={color} />}
      {state === "off_range" && <path d="M6 1.8 10.6 10.2H1.4Z" fill="none" stroke={color} strokeWidth="1.6" strokeLinejoin="round" />}
      {state === "stressed" && <path d="M6 0.5 11.8 11H0.2Z" fill={color} />}
      {state === "critical" && <rect x="1" y="1" width="10" height="10" fill={color} />}
      {state === "no_data" && <circle cx="6" cy="6" r="4.2" fill="none" stroke={color} strokeWidth="1.6" />}
    </svg>
  );
}

/** A tulip in the color of its species. */
export function FlowerMark({ species, className }: { species: string; className?: string }) {
  return (
    <svg aria-hidden="true" viewBox="0 0 12 16" className={cn("h-4 w-3 shrink-0", className)}>
      <path d="M6 9v7" stroke={STEM_COLOR} strokeWidth="1.6" />
      <path d="M1.2 1.2 4 3.6 6 0.6 8 3.6 10.8 1.2C11.6 6.4 9.6 10 6 10S0.4 6.4 1.2 1.2Z" fill={speciesColor(species)} />
    </svg>
  );
}

/** An exclamation mark on a disc: a bug was seen. */
export function BugMark({ label, className }: { label: string; className?: string }) {
  return (
    <span role="img" aria-label={label} title={label} className={cn("inline-grid size-4 shrink-0 place-items-center rounded-full bg-attention text-xs leading-none font-extrabold text-void", className)}>
      <span aria-hidden="true">!</span>
    </span>
  );
}
