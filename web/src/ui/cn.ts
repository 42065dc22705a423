import { type ClassValue, clsx } from "clsx";
import { extendTailwindMerge } from "tailwind-merge";

// text-lead is a size of the tokens, not a color.
const merge = extendTailwindMerge({ extend: { theme: { text: ["lead"] } } });

/** Class names, of which the last of several that contradict each other holds. */
export function cn(...inputs: ClassValue[]): string {
  return merge(clsx(inputs));
}
