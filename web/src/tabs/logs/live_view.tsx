import { ArrowDownToLine, CircleAlert, Dot, Info, OctagonAlert, Pause, Play, Search, Trash2, TriangleAlert, X } from "lucide-react";
import { type ComponentType, useMemo, useState } from "react";
import { create } from "zustand";
import { useAge } from "@/hooks/use_now";
import { type TextKey, useText } from "@/i18n/text";
import { useSetting } from "@/state/settings";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { formatDuration } from "@/ui/numbers";
import { Segments } from "@/ui/segments";
import { VirtualList } from "@/widgets/virtual_list";
import { CopyButton } from "./copy_button";
import { type LogFilter, SEVERITIES, filteredRows, rowText, rowTime } from "./log_filter";
import { type Level, type LogRow, MAX_ROWS, type Tail } from "./log_store";
import { LOGS, useLogTail } from "./use_logs";
import { useIsNarrow } from "./use_is_narrow";

export const LEVELS: Record<Level, { label: TextKey; icon: ComponentType<{ className?: string }>; tone: string }> = {
  debug: { label: "logs_debug", icon: Dot, tone: "text-text-3" },
  info: { label: "logs_info", icon: Info, tone: "text-text-2" },
  warning: { label: "logs_warning", icon: TriangleAlert, tone: "text-attention" },
  error: { label: "logs_error", icon: CircleAlert, tone: "text-stop-text" },
  fatal: { label: "logs_fatal", icon: OctagonAlert, tone: "text-stop-text" },
};

export const FIELD = "h-10 min-w-0 rounded-md border border-line-strong bg-well px-3 text-sm max-xl:h-11 pointer-coarse:h-11";

const useFilter = create<LogFilter>(() => ({ severity: "info", node: "", search: "" }));

const ROW_PX = 32;
const NARROW_ROW_PX = 60;
const idOf = (row: LogRow) => row.id;

/** The tail of the robot's log. */
export function LiveView() {
  const text = useText();
  const topic = useSetting("rosoutTopic");
  const live = useLogTail(topic);
  const filter = useFilter();
  const [frozen, setFrozen] = useState<Tail | null>(null);
  const [isFollowing, setFollowing] = useState(true);
  const [selected, setSelected] = useState<LogRow | null>(null);
  const isNarrow = useIsNarrow();
  const age = useAge(live.lastMs);
  const tail = frozen ?? live;
  const rows = useMemo(() => filteredRows(tail, filter), [tail, filter]);

  return (
    <>
      <div className="flex flex-wrap items-center gap-2">
        <Segments label={text("logs_severity")} value={filter.severity} options={SEVERITIES.map((value) => ({ value, label: text(`logs_severity_${value}`) }))} onChange={(severity) => useFilter.setState({ severity })} />
        <select aria-label={text("logs_node")} value={filter.node} onChange={(event) => useFilter.setState({ node: event.target.value })} className={cn(FIELD, "w-28 grow md:w-48 md:max-w-60")}>
          <option value="">{text("logs_all_nodes")}</option>
          {[...new Set([...live.nodes, filter.node])].filter(Boolean).map((node) => (
            <option key={node} value={node}>
              {node}
            </option>
          ))}
        </select>
        <SearchField value={filter.search} onChange={(search) => useFilter.setState({ search })} />
        <Button aria-pressed={frozen !== null} onClick={() => setFrozen(frozen === null ? live : null)}>
          {frozen === null ? <Pause /> : <Play />}
          <span className="max-md:sr-only">{text(frozen === null ? "logs_pause" : "logs_resume")}</span>
        </Button>
        <Button
          onClick={() => {
            LOGS.clear();
            setFrozen(null);
            setSelected(null);
          }}
        >
          <Trash2 />
          <span className="max-md:sr-only">{text("logs_clear")}</span>
        </Button>
        <Button aria-pressed={isFollowing} className={cn(isFollowing && "border-alive-2 text-alive")} onClick={() => setFollowing(!isFollowing)}>
          <ArrowDownToLine />
          <span className="max-md:sr-only">{text("logs_follow")}</span>
        </Button>
      </div>
      <div className="panel flex min-h-72 grow flex-col overflow-hidden">
        {rows.length === 0 ? (
          <p className="grid grow place-items-center p-8 text-center text-text-2">
            {live.received === 0 ? text("no_sample_yet", { topic }) : text("logs_none_match", { count: tail.rows.length })}
          </p>
        ) : (
          <VirtualList
            label={text("logs_live")}
            items={rows}
            idOf={idOf}
            itemHeight={isNarrow ? NARROW_ROW_PX : ROW_PX}
            isFollowing={isFollowing && frozen === null}
            onFollow={setFollowing}
            className="min-h-0 grow py-1"
            render={(row) => <Line row={row} isNarrow={isNarrow} isSelected={row.id === selected?.id} onSelect={() => setSelected(row)} />}
          />
        )}
        {selected !== null && <Details row={selected} onClose={() => setSelected(null)} />}
        <div className="flex flex-wrap items-center gap-x-4 border-t border-line px-4 py-2 text-xs text-text-3">
          <span>{text("logs_shown", { shown: rows.length, kept: Math.min(tail.rows.length, MAX_ROWS), received: live.received })}</span>
          {frozen !== null && <span className="text-attention">{text("logs_paused", { count: live.received - frozen.received })}</span>}
          {age !== null && <span className="ml-auto">{text("logs_last", { age: formatDuration(age) })}</span>}
        </div>
      </div>
    </>
  );
}

export function SearchField({ value, onChange }: { value: string; onChange: (value: string) => void }) {
  const text = useText();
  return (
    <div className="relative min-w-36 grow basis-36 max-md:order-last max-md:basis-full md:basis-48">
      <Search aria-hidden="true" className="pointer-events-none absolute top-1/2 left-3 size-4 -translate-y-1/2 text-text-3" />
      <input
        type="search"
        value={value}
        onChange={(event) => onChange(event.target.value)}
        aria-label={text("logs_search")}
        placeholder={text("logs_search")}
        autoComplete="off"
        spellCheck={false}
        className={cn(FIELD, "w-full pl-9 placeholder:text-text-3")}
      />
    </div>
  );
}

function Line({ row, isNarrow, isSelected, onSelect }: { row: LogRow; isNarrow: boolean; isSelected: boolean; onSelect: () => void }) {
  const text = useText();
  const { label, icon: Icon, tone } = LEVELS[row.level];
  const meta = (
    <>
      <span className="shrink-0 text-xs text-text-3 numeric">{rowTime(row.timeS)}</span>
      <span className={cn("flex w-20 shrink-0 items-center gap-1.5 text-xs", tone)}>
        <Icon aria-hidden="true" className="size-4 shrink-0" />
        {text(label)}
      </span>
      <span className="w-44 shrink-0 truncate text-left text-xs text-text-2 numeric max-lg:w-32 max-md:w-auto max-md:shrink">{row.node}</span>
    </>
  );
  const message = (
    <span lang="en" className={cn("min-w-0 grow truncate text-left text-sm", row.level === "debug" ? "text-text-3" : row.level === "info" ? "text-text" : tone)}>{row.message}</span>
  );
  return (
    <button
      type="button"
      aria-pressed={isSelected}
      onClick={onSelect}
      className={cn(
        "flex size-full items-center gap-3 px-4 -outline-offset-2 hover:bg-raised",
        isNarrow && "flex-col items-stretch justify-center gap-1",
        isSelected && "bg-raised shadow-[inset_2px_0_0_var(--color-sensed)]",
      )}
    >
      {isNarrow ? <span className="flex items-center gap-3">{meta}</span> : meta}
      {message}
    </button>
  );
}

/** A complete row: the full text, which the list truncates, its source, and a button that copies it. */
function Details({ row, onClose }: { row: LogRow; onClose: () => void }) {
  const text = useText();
  const { label, icon: Icon, tone } = LEVELS[row.level];
  return (
    <div className="border-t border-line-strong bg-raised px-4 py-3">
      <div className="flex flex-wrap items-center gap-x-4 gap-y-1 text-xs">
        <span className={cn("flex items-center gap-1.5 font-semibold", tone)}>
          <Icon aria-hidden="true" className="size-4" />
          {text(label)}
        </span>
        <span className="numeric">{rowTime(row.timeS)}</span>
        <span className="text-text-2 numeric">{row.node}</span>
        <span className="min-w-0 grow truncate text-text-3 numeric">{row.place}</span>
        <CopyButton textToCopy={rowText(row)} />
        <Button kind="quiet" size="icon" aria-label={text("close")} onClick={onClose}>
          <X />
        </Button>
      </div>
      <p lang="en" className="mt-2 max-h-40 overflow-y-auto text-sm break-words whitespace-pre-wrap">{row.message}</p>
    </div>
  );
}
