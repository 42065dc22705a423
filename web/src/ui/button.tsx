import { type VariantProps, cva } from "class-variance-authority";
import { Slot } from "radix-ui";
import type { ComponentProps } from "react";
import { cn } from "./cn";

const styles = cva(
  "inline-flex shrink-0 items-center justify-center gap-2 rounded-md font-semibold whitespace-nowrap select-none " +
    "transition-colors duration-150 disabled:cursor-not-allowed disabled:text-text-3 disabled:border-line " +
    "disabled:bg-transparent aria-disabled:cursor-not-allowed aria-disabled:text-text-3 [&_svg]:size-[1.2em] [&_svg]:shrink-0",
  {
    variants: {
      kind: {
        plain: "border border-line-strong bg-raised hover:bg-hover",
        quiet: "border border-transparent text-text-2 hover:bg-hover hover:text-text",
        primary: "border border-alive bg-alive text-alive-ink hover:bg-alive/85",
        danger: "border border-stop bg-stop text-white hover:bg-stop/85",
      },
      size: {
        medium: "h-10 px-4 text-sm pointer-coarse:h-11 max-xl:h-11",
        small: "h-8 px-3 text-xs pointer-coarse:h-11 max-xl:h-11",
        icon: "size-10 pointer-coarse:size-11 max-xl:size-11",
      },
    },
    defaultVariants: { kind: "plain", size: "medium" },
  },
);

export function Button({
  kind,
  size,
  asChild = false,
  className,
  type,
  ...rest
}: ComponentProps<"button"> & VariantProps<typeof styles> & { asChild?: boolean }) {
  if (asChild) return <Slot.Root className={cn(styles({ kind, size }), className)} {...rest} />;
  return <button type={type ?? "button"} className={cn(styles({ kind, size }), className)} {...rest} />;
}
