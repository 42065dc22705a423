import { Ban, CircleCheck, RefreshCw } from "lucide-react";
import { memo, useCallback, useMemo, useState } from "react";
import { getJson } from "@/api/http";
import { useAge } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { UNKNOWN, formatDuration, timeOfDay } from "@/ui/numbers";
import { Segments } from "@/ui/segments";
import { ScrollRegion } from "@/widgets/scroll_region";
import { SearchField } from "./live_view";
import { type JournalRow, parseJournal } from "./run_files";
import { RunSelect, useRuns } from "./run_select";
import { usePolled } from "./use_polled";

const POLL_MS = 4000;

/** The command journal: who asked the console for what, and what was refused. */
export function JournalView() {
  const text = useText();
  const { id, isUp, runs, problem: runsProblem } = useRuns();
  const [search, setSearch] = useState("");
  const [outcome, setOutcome] = useState<"all" | "refused">("all");
  const read = useCallback(async () => parseJournal(await getJson<unknown>(`/_api/runs/${encodeURIComponent(id)}/commands`)), [id]);
  const journal = usePolled(id === "" ? null : read, isUp ? POLL_MS : null);
  const age = useAge(journal.receivedMs);
  const wanted = search.trim().toLowerCase();
  const all = journal.value;
  const rows = useMemo(
    () =>
      (all ?? []).filter(
        (row) => (outcome === "all" || row.refused !== "") && (wanted === "" || `${row.session} ${row.what} ${row.detail} ${row.refused}`.toLowerCase().includes(wanted)),
      ),
    [all, outcome, wanted],
  );
  const problem = runsProblem || journal.problem;
  return (
    <>
      <div className="flex flex-wrap items-center gap-2">
        <RunSelect id={id} runs={runs} />
        <Segments
          label={text("logs_outcome")}
          value={outcome}
          options={[
            { value: "all", label: text("logs_outcome_all") },
            { value: "refused", label: text("logs_outcome_refused") },
          ]}
          onChange={setOutcome}
        />
        <SearchField value={search} onChange={setSearch} />
        <Button onClick={journal.reload} disabled={id === ""}>
          <RefreshCw />
          <span className="max-md:sr-only">{text("logs_reload")}</span>
        </Button>
      </div>
      <div className="panel flex min-h-72 grow flex-col overflow-hidden md:min-h-0">
        {rows.length > 0 ? (
          <ScrollRegion aria-label={text("logs_view_commands")} className="min-h-0 grow">
            <ul>
              {rows.map((row, index) => (
                <Entry key={`${row.timeMs} ${row.what} ${rows.length - index}`} row={row} />
              ))}
            </ul>
          </ScrollRegion>
        ) : (
          <p className="grid grow place-items-center p-8 text-center text-text-2">
            {id === "" ? text("logs_no_runs_explained") : all === null ? text(problem === "" ? "loading" : "logs_unreadable") : text(all.length === 0 ? "logs_no_commands" : "logs_no_line_matches")}
          </p>
        )}
        <div className={cn("flex flex-wrap gap-x-4 border-t border-line px-4 py-2 text-xs", problem === "" ? "text-text-3" : "text-attention")}>
          <span>{problem === "" ? text("logs_commands", { count: rows.length }) : text("logs_problem", { reason: problem })}</span>
          {age !== null && <span className="ml-auto">{text("logs_read", { age: formatDuration(age) })}</span>}
        </div>
      </div>
    </>
  );
}

const Entry = memo(function Entry({ row }: { row: JournalRow }) {
  const text = useText();
  const isRefused = row.refused !== "";
  const time = Number.isFinite(row.timeMs) ? timeOfDay(new Date(row.timeMs)) : UNKNOWN;
  return (
    <li className="grid grid-cols-[auto_minmax(0,1fr)] items-start gap-x-4 border-b border-line px-4 py-2 [content-visibility:auto] [contain-intrinsic-size:auto_44px] md:grid-cols-[6.5rem_9rem_minmax(0,1fr)]">
      <span className="pt-0.5 text-xs text-text-3 numeric">{time}</span>
      <span className="truncate text-sm text-text-2 max-md:text-right">{row.session}</span>
      <div className="min-w-0 max-md:col-span-2">
        <p className={cn("flex items-start gap-2 text-sm", isRefused ? "text-attention" : "text-text")}>
          {isRefused ? <Ban aria-hidden="true" className="mt-0.5 size-4 shrink-0" /> : <CircleCheck aria-hidden="true" className="mt-0.5 size-4 shrink-0 text-text-3" />}
          <span className="min-w-0 break-words">
            <span lang="en" className="font-semibold">{row.what}</span>
            {row.repeats > 0 && <span className="ml-2 text-xs text-text-3">{text("logs_repeats", { count: row.repeats })}</span>}
            {isRefused && <span className="block text-xs">{text("logs_refused", { reason: row.refused })}</span>}
            {row.detail !== "" && <span className="block text-xs break-all text-text-3 numeric">{row.detail}</span>}
          </span>
        </p>
      </div>
    </li>
  );
});
