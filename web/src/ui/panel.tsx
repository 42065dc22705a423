import { type ReactNode, useId } from "react";
import { type Text, useText } from "@/i18n/text";
import { cn } from "./cn";

interface PanelProps {
  title: string;
  /** What stands opposite of the title: a count, an age, a unit. */
  aside?: ReactNode;
  /** Since when there is nothing new, and what helps; the body is hatched then and the text stands at its foot. */
  notice?: ReactNode;
  tone?: "stale" | "error" | "empty";
  children: ReactNode;
  className?: string;
  bodyClassName?: string;
}

/** An instrument: a solid tile with a head, a body that keeps its size, and a foot that says what is missing. */
export function Panel({ title, aside, notice, tone, children, className, bodyClassName }: PanelProps) {
  const text = useText();
  const heading = useId();
  return (
    <section aria-labelledby={heading} className={cn("panel flex min-h-0 min-w-0 flex-col", className)}>
      <header className="flex items-baseline gap-3 px-4 pt-3 pb-2">
        <h2 id={heading} className="grow truncate text-sm font-semibold text-text-2">
          {title}
        </h2>
        {aside !== undefined && <div className="shrink-0 text-xs text-text-3">{aside}</div>}
      </header>
      <div className={cn("min-h-0 grow px-4 pb-3", tone === "stale" && "hatched", tone !== undefined && "text-text-3", bodyClassName)}>
        {children}
      </div>
      {notice !== undefined && notice !== null && (
        <div
          className={cn(
            "flex items-center gap-2 border-t border-line px-4 py-2 text-xs",
            tone === "error" ? "text-stop-text" : tone === "stale" ? "text-attention" : "text-text-2",
          )}
        >
          {notice}
        </div>
      )}
      <span role="status" className="sr-only">
        {announcement(text, title, tone, notice)}
      </span>
    </section>
  );
}

/** What is read out of a notice: that it came, not the age in it. */
function announcement(text: Text, title: string, tone: PanelProps["tone"], notice: ReactNode): string {
  if (notice === undefined || notice === null) return "";
  if (tone === "stale") return `${title}: ${text("stale")}`;
  return tone === "empty" || typeof notice !== "string" ? "" : notice;
}
