import { Check, House, Minus, Search, X } from "lucide-react";
import { type ReactNode, memo, useEffect, useRef } from "react";
import { type Text, type TextKey, useText } from "@/i18n/text";
import { toggleTag } from "@/map/map_ui";
import type { Stop, StopState } from "@/map/transit";
import type { Tag } from "@/map/twin";
import { cn } from "@/ui/cn";
import { clock } from "@/ui/numbers";

interface TransitLineProps {
  stops: readonly Stop[];
  tags: readonly Tag[];
  startedS: number;
  isPaused: boolean;
  /** Whether tags are still being searched for, so that the line has no end yet. */
  isSearching: boolean;
  isReturning: boolean;
  isDone: boolean;
}

/** The mission as a transit line: the visited part is a solid line, the rest a dotted one. */
export const TransitLine = memo(function TransitLine({ stops, tags, startedS, isPaused, isSearching, isReturning, isDone }: TransitLineProps) {
  const text = useText();
  const line = useRef<HTMLOListElement>(null);
  const currentIndex = stops.findIndex((stop) => stop.state === "current");
  const shownIndex = currentIndex < 0 ? stops.length : currentIndex;
  useEffect(() => {
    const stop = line.current?.children[shownIndex + 1];
    if (line.current === null || !(stop instanceof HTMLElement)) return;
    line.current.scrollLeft = stop.offsetLeft - line.current.offsetLeft - (line.current.clientWidth - stop.offsetWidth) / 2;
  }, [shownIndex]);
  const isHome = isReturning || isDone;
  return (
    <ol ref={line} aria-label={text("mission_line")} className="flex overflow-x-auto px-3 pt-1 pb-3">
      <Station label={text("mission_line_start")} before="none" after={stops.length === 0 ? "ahead" : "done"}>
        <House className="size-5 text-text-2" />
      </Station>
      {stops.map((stop, index) => (
        <Station
          key={`${index} ${stop.tag}`}
          label={stop.tag === "" ? String(index + 1) : stop.tag}
          note={noteOf(text, stop, tags, startedS, isPaused)}
          isCurrent={stop.state === "current"}
          isAhead={stop.state === "next" || stop.state === "open"}
          before={legTo(stop.state, isPaused)}
          after={index + 1 < stops.length ? legTo(stops[index + 1]?.state ?? "open", isPaused) : isHome ? "done" : "ahead"}
          {...(stop.tag === "" ? {} : { onClick: () => toggleTag(stop.tag) })}
        >
          <StopMark state={stop.state} isPaused={isPaused} />
        </Station>
      ))}
      <Station
        label={isSearching ? "" : text("mission_line_dock")}
        before={isHome ? "done" : "ahead"}
        after="none"
        {...(isSearching ? { note: { text: text("mission_searching"), isAlarming: false } } : {})}
      >
        {isSearching ? <Search aria-hidden="true" className="size-4 text-text-3" /> : <House className={cn("size-5", isDone ? "text-alive" : "text-text-3")} />}
      </Station>
    </ol>
  );
});

type Leg = "done" | "now" | "held" | "ahead" | "none";

function legTo(state: StopState, isPaused: boolean): Leg {
  if (state === "current") return isPaused ? "held" : "now";
  return state === "next" || state === "open" ? "ahead" : "done";
}

const LEGS: Record<Leg, string> = {
  done: "h-1 bg-alive-2",
  now: "h-1 bg-alive",
  held: "border-t-2 border-dotted border-text-2",
  ahead: "border-t-2 border-dotted border-line-strong",
  none: "",
};

interface Note {
  text: string;
  isAlarming: boolean;
}

/** The note at a stop: what needs the operator's attention, or else the time of the visit. */
function noteOf(text: Text, stop: Stop, tags: readonly Tag[], startedS: number, isPaused: boolean): Note {
  const words: Record<StopState, TextKey> = {
    done: "mission_stop_done",
    failed: "mission_stop_failed",
    skipped: "mission_stop_skipped",
    current: isPaused ? "mission_stop_paused" : "mission_stop_current",
    next: "mission_stop_next",
    open: "mission_stop_open",
  };
  if (stop.state === "failed") return { text: text(words.failed), isAlarming: true };
  if (stop.state !== "done") return { text: text(words[stop.state]), isAlarming: false };
  const tag = tags.find(({ id }) => id === stop.tag);
  if (tag?.health.state === "critical") return { text: text("map_critical").toLowerCase(), isAlarming: true };
  if (tag?.hasBug === true) return { text: text("mission_stop_bug"), isAlarming: true };
  if (tag?.health.state === "stressed") return { text: text("map_stressed").toLowerCase(), isAlarming: true };
  const isTimed = stop.timeS !== undefined && startedS > 0 && stop.timeS >= startedS;
  return { text: isTimed ? clock((stop.timeS ?? 0) - startedS) : text(words.done), isAlarming: false };
}

interface StationProps {
  label: string;
  note?: Note;
  isCurrent?: boolean;
  isAhead?: boolean;
  before: Leg;
  after: Leg;
  onClick?: () => void;
  children: ReactNode;
}

function Station({ label, note, isCurrent = false, isAhead = false, before, after, onClick, children }: StationProps) {
  const name = <span className={cn("max-w-16 truncate leading-tight", isCurrent ? "text-lg font-bold text-alive" : isAhead ? "text-base text-text-2" : "text-base font-semibold")}>{label}</span>;
  const text = note !== undefined && <span className={cn("px-1.5 text-xs leading-tight whitespace-nowrap numeric", note.isAlarming ? "font-sans text-attention" : "text-text-3")}>{note.text}</span>;
  return (
    <li {...(isCurrent ? { "aria-current": "step" as const } : {})} className="flex min-w-max grow basis-0 flex-col">
      <span aria-hidden="true" className="flex h-8 min-w-15 items-center">
        <span className={cn("grow", LEGS[before])} />
        <span className="grid shrink-0 place-items-center px-0.5">{children}</span>
        <span className={cn("grow", LEGS[after])} />
      </span>
      {onClick === undefined ? (
        <span className="flex min-h-10 flex-col items-center">
          <span className="text-xs text-text-3">{label}</span>
          {text}
        </span>
      ) : (
        <button type="button" onClick={onClick} className="flex min-h-11 flex-col items-center rounded-sm hover:bg-hover">
          {name}
          {text}
        </button>
      )}
    </li>
  );
}

/** A visited, the current and a future stop have different shapes. */
function StopMark({ state, isPaused }: { state: StopState; isPaused: boolean }) {
  switch (state) {
    case "done":
      return (
        <span className="grid size-5 place-items-center rounded-full bg-alive-2 text-base">
          <Check className="size-3.5 text-void" strokeWidth={3.5} />
        </span>
      );
    case "failed":
      return (
        <span className="grid size-5 place-items-center rounded-sm bg-attention">
          <X className="size-3.5 text-void" strokeWidth={3.5} />
        </span>
      );
    case "skipped":
      return (
        <span className="grid size-5 place-items-center rounded-full border-2 border-text-3">
          <Minus className="size-3 text-text-3" strokeWidth={3} />
        </span>
      );
    case "current":
      return (
        <span className={cn("grid size-8 place-items-center rounded-full border-[3px]", isPaused ? "border-text" : "border-alive")}>
          <span className={cn("size-3.5 rounded-full", isPaused ? "bg-text" : "bg-alive")} />
        </span>
      );
    case "next":
      return <span className="size-5 rounded-full border-2 border-text-2" />;
    case "open":
      return <span className="size-4 rounded-full border-2 border-line-strong" />;
  }
}
