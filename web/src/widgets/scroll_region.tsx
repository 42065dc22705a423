import type { ComponentProps } from "react";
import { cn } from "@/ui/cn";

interface ScrollRegionProps extends Omit<ComponentProps<"div">, "role" | "tabIndex"> {
  "aria-label": string;
}

// WCAG 2.1.1: what scrolls and holds nothing to press must take the focus itself. The linter's rule knows no such regions.
const FOCUSABLE = { role: "region", tabIndex: 0 } as const;

/** A scrolled area that the keyboard reaches. */
export function ScrollRegion({ className, ...rest }: ScrollRegionProps) {
  return <div {...FOCUSABLE} className={cn("overflow-auto -outline-offset-2", className)} {...rest} />;
}
