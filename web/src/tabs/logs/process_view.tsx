import { ArrowDownToLine, RefreshCw } from "lucide-react";
import { memo, useCallback, useEffect, useMemo, useRef, useState } from "react";
import { create } from "zustand";
import { getJson } from "@/api/http";
import { useAge } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { formatDuration } from "@/ui/numbers";
import { ScrollRegion } from "@/widgets/scroll_region";
import { SearchField } from "./live_view";
import { type LineTone, type TextLine, askText, logLines, parseNames } from "./run_files";
import { RunSelect, useRuns } from "./run_select";
import { usePolled } from "./use_polled";

const useChosenProcess = create<{ name: string }>(() => ({ name: "" }));

const FOLLOW_MS = 3000;
/** Lines are grouped into blocks, which the browser lays out only when they come into view. */
const BLOCK_LINES = 100;
const LINE_PX = 20;

const TONES: Record<LineTone, string> = { plain: "text-text-2", warning: "text-attention", error: "text-stop-text" };

/** The log files of a run's processes. */
export function ProcessView() {
  const text = useText();
  const { id, isUp, runs, problem: runsProblem } = useRuns();
  const [search, setSearch] = useState("");
  const [isFollowing, setFollowing] = useState(true);
  const chosen = useChosenProcess((state) => state.name);

  const readNames = useCallback(async () => parseNames(await getJson<unknown>(`/_api/runs/${encodeURIComponent(id)}/logs`)), [id]);
  const names = usePolled(id === "" ? null : readNames, isUp ? 15_000 : null);
  const processes = names.value ?? [];
  const name = processes.includes(chosen) ? chosen : (processes[0] ?? "");

  const readLog = useCallback(() => askText(`/_api/runs/${encodeURIComponent(id)}/logs/${encodeURIComponent(name)}`), [id, name]);
  const log = usePolled(name === "" ? null : readLog, isUp && isFollowing ? FOLLOW_MS : null);
  const lines = useMemo(() => logLines(log.value ?? ""), [log.value]);
  const wanted = search.trim().toLowerCase();
  const shown = useMemo(() => (wanted === "" ? lines : lines.filter((line) => line.text.toLowerCase().includes(wanted))), [lines, wanted]);
  const problem = runsProblem || names.problem || log.problem;
  const age = useAge(log.receivedMs);

  return (
    <>
      <div className="flex flex-wrap items-center gap-2">
        <RunSelect id={id} runs={runs} />
        <SearchField value={search} onChange={setSearch} />
        <Button onClick={log.reload} disabled={name === ""}>
          <RefreshCw />
          <span className="max-md:sr-only">{text("logs_reload")}</span>
        </Button>
        <Button aria-pressed={isFollowing} disabled={!isUp} className={cn(isFollowing && isUp && "border-alive-2 text-alive")} onClick={() => setFollowing(!isFollowing)}>
          <ArrowDownToLine />
          <span className="max-md:sr-only">{text("logs_follow")}</span>
        </Button>
      </div>
      <div className="grid min-h-72 grow grid-cols-[minmax(0,1fr)] grid-rows-[auto_minmax(0,1fr)] gap-3 md:min-h-0 md:grid-cols-[11rem_minmax(0,1fr)] md:grid-rows-[minmax(0,1fr)]">
        <ul aria-label={text("logs_processes")} className="panel flex gap-1 overflow-auto p-2 md:flex-col">
          {processes.map((process) => (
            <li key={process} className="shrink-0">
              <button
                type="button"
                aria-pressed={process === name}
                onClick={() => useChosenProcess.setState({ name: process })}
                className={cn("min-h-9 w-full rounded-sm px-3 text-left text-sm hover:bg-hover max-xl:min-h-11", process === name ? "bg-raised font-semibold text-text" : "text-text-2")}
              >
                {process}
              </button>
            </li>
          ))}
        </ul>
        <div className="panel flex min-h-64 min-w-0 flex-col overflow-hidden">
          {shown.length > 0 ? (
            <LineList label={text("logs_of_process", { process: name })} lines={shown} isFollowing={isFollowing && isUp} />
          ) : (
            <p className="grid grow place-items-center p-8 text-center text-text-2">{emptyText()}</p>
          )}
          <div className={cn("flex flex-wrap gap-x-4 border-t border-line px-4 py-2 text-xs", problem === "" ? "text-text-3" : "text-attention")}>
            <span>{problem === "" ? text("logs_lines", { count: shown.length }) : text("logs_problem", { reason: problem })}</span>
            {age !== null && <span className="ml-auto">{text("logs_read", { age: formatDuration(age) })}</span>}
          </div>
        </div>
      </div>
    </>
  );

  function emptyText(): string {
    if (id === "") return text("logs_no_runs_explained");
    if (names.value !== null && processes.length === 0) return text("logs_no_files");
    if (log.value === null) return text(problem === "" ? "loading" : "logs_unreadable");
    return text(lines.length === 0 ? "logs_file_empty" : "logs_no_line_matches");
  }
}

function LineList({ label, lines, isFollowing }: { label: string; lines: readonly TextLine[]; isFollowing: boolean }) {
  const frame = useRef<HTMLDivElement>(null);
  const blocks = useMemo(() => {
    const made: TextLine[][] = [];
    for (let index = 0; index < lines.length; index += BLOCK_LINES) made.push(lines.slice(index, index + BLOCK_LINES));
    return made;
  }, [lines]);

  useEffect(() => {
    const element = frame.current;
    if (element !== null && isFollowing && blocks.length > 0) element.scrollTop = element.scrollHeight;
  }, [blocks, isFollowing]);

  return (
    <ScrollRegion ref={frame} aria-label={label} className="min-h-0 grow px-4 py-2 text-xs leading-5 numeric">
      {blocks.map((block, index) => (
        <Block key={index} lines={block} />
      ))}
    </ScrollRegion>
  );
}

const Block = memo(function Block({ lines }: { lines: readonly TextLine[] }) {
  return (
    <div className="[content-visibility:auto]" style={{ containIntrinsicSize: `auto ${lines.length * LINE_PX}px` }}>
      {lines.map((line) => (
        <p key={line.number} lang="en" className={cn("break-words whitespace-pre-wrap", TONES[line.tone])}>
          {line.text || " "}
        </p>
      ))}
    </div>
  );
});
