import { useCallback } from "react";
import { create } from "zustand";
import { useConsole } from "@/api/console_store";
import { getJson } from "@/api/http";
import { useText } from "@/i18n/text";
import { cn } from "@/ui/cn";
import { dayAndTime } from "@/ui/numbers";
import { FIELD } from "./live_view";
import { type StoredRun, parseRuns } from "./run_files";
import { usePolled } from "./use_polled";

/** The run whose files are shown; empty: the one that is up, or else the newest. */
const useChosenRun = create<{ id: string }>(() => ({ id: "" }));

const readRuns = async (): Promise<StoredRun[]> => parseRuns(await getJson<unknown>("/_api/runs"));

/** The shown run and the list to choose from; `id` is empty while there is none. */
export function useRuns(): { id: string; isUp: boolean; runs: readonly StoredRun[]; problem: string } {
  const { value, problem } = usePolled(readRuns, 15_000);
  const chosen = useChosenRun((state) => state.id);
  const current = useConsole((state) => state.run.id ?? "");
  const runs = value ?? [];
  const id = runs.some((run) => run.id === chosen) ? chosen : current !== "" ? current : (runs[0]?.id ?? "");
  const isUp = id !== "" && (id === current || runs.some((run) => run.id === id && run.state === "up"));
  return { id, isUp, runs, problem };
}

export function RunSelect({ id, runs }: { id: string; runs: readonly StoredRun[] }) {
  const text = useText();
  const choose = useCallback((next: string) => useChosenRun.setState({ id: next }), []);
  const listed = runs.some((run) => run.id === id) || id === "" ? runs : [{ id, state: "up", startedS: null }, ...runs];
  return (
    <select aria-label={text("logs_run")} value={id} onChange={(event) => choose(event.target.value)} className={cn(FIELD, "w-60 grow md:max-w-96")}>
      {listed.length === 0 && <option value="">{text("logs_no_runs")}</option>}
      {listed.map((run) => (
        <option key={run.id} value={run.id}>
          {[run.id, run.state, run.startedS === null ? "" : dayAndTime(new Date(run.startedS * 1000))].filter(Boolean).join(" · ")}
        </option>
      ))}
    </select>
  );
}
