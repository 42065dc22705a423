import { CircleCheck, CircleX, Hourglass, LoaderCircle, Square, TriangleAlert } from "lucide-react";
import type { ComponentType } from "react";
import { useConsole } from "@/api/console_store";
import { useAge } from "@/hooks/use_now";
import { type TextKey, useText } from "@/i18n/text";
import { DoctorButton } from "@/widgets/doctor_button";
import { cn } from "@/ui/cn";
import { UNKNOWN, fixed, formatDuration } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { ScrollRegion } from "@/widgets/scroll_region";
import { type ProcessHealth, type ProcessRow, type RateRow, processRows, rateRows } from "./run_rows";

const HEALTH: Record<ProcessHealth, { label: TextKey; icon: ComponentType<{ className?: string }>; tone: string }> = {
  up: { label: "telemetry_process_up", icon: CircleCheck, tone: "text-text-2" },
  trouble: { label: "telemetry_process_trouble", icon: TriangleAlert, tone: "text-attention" },
  starting: { label: "telemetry_process_starting", icon: LoaderCircle, tone: "text-sensed" },
  waiting: { label: "telemetry_process_waiting", icon: Hourglass, tone: "text-text-2" },
  failed: { label: "telemetry_process_failed", icon: CircleX, tone: "text-stop-text" },
  stopped: { label: "telemetry_process_stopped", icon: Square, tone: "text-text-3" },
};

/** The run: its alarms, its processes, and the rates of its topics. */
export function RunView() {
  const text = useText();
  const run = useConsole((state) => state.run);
  const isOnline = useConsole((state) => state.online);
  const onlineChangedMs = useConsole((state) => state.onlineChangedMs);
  const offlineAge = useAge(onlineChangedMs);
  const processes = processRows(run);
  const rates = rateRows(run);
  const alarms = run.alarms ?? [];
  const stale = !isOnline && processes.length > 0 ? { tone: "stale" as const, notice: text("telemetry_run_stale", { age: formatDuration(offlineAge) }) } : {};
  const empty = processes.length === 0 ? { tone: "empty" as const, notice: text("telemetry_no_run") } : {};
  const up = processes.filter(({ health }) => health === "up").length;
  return (
    <div className="flex grow flex-col gap-3 xl:min-h-0">
      {alarms.length > 0 && (
        <section aria-label={text("telemetry_alarms")} className="panel flex flex-wrap items-center gap-x-4 gap-y-2 border-attention/60 px-4 py-3">
          <ul className="min-w-0 grow">
            {alarms.map((alarm) => (
              <li key={alarm} className="flex items-start gap-2.5 py-0.5 text-attention">
                <TriangleAlert aria-hidden="true" className="mt-0.5 size-4 shrink-0" />
                <span className="min-w-0 break-words">{alarm}</span>
              </li>
            ))}
          </ul>
          <DoctorButton size="small" />
        </section>
      )}
      <div className="grid grow grid-cols-[minmax(0,1fr)] gap-3 xl:min-h-0 xl:grid-cols-[minmax(0,3fr)_minmax(0,2fr)] xl:grid-rows-[minmax(0,1fr)]">
        <Panel
          title={text("telemetry_processes")}
          aside={processes.length > 0 && text("telemetry_processes_up", { up, total: processes.length, age: formatDuration(run.age_s) })}
          {...stale}
          {...empty}
          className="min-h-64"
          bodyClassName="flex"
        >
          {processes.length > 0 && (
            <ScrollRegion aria-label={text("telemetry_processes_table")} className="min-w-0 grow">
              <ProcessTable rows={processes} />
            </ScrollRegion>
          )}
        </Panel>
        <Panel title={text("telemetry_rates")} aside={text("telemetry_rates_hint")} {...stale} {...empty} className="min-h-64" bodyClassName="flex">
          {rates.length > 0 && (
            <ScrollRegion aria-label={text("telemetry_rates_table")} className="min-w-0 grow">
              <RateTable rows={rates} />
            </ScrollRegion>
          )}
        </Panel>
      </div>
    </div>
  );
}

function ProcessTable({ rows }: { rows: readonly ProcessRow[] }) {
  const text = useText();
  return (
    <table className="w-full text-left">
      <thead className="sticky top-0 bg-panel text-xs text-text-3">
        <tr>
          <th className="py-1 pr-3 font-normal">{text("telemetry_process")}</th>
          <th className="py-1 pr-3 font-normal">{text("telemetry_state")}</th>
          <th className="py-1 pr-3 text-right font-normal">{text("telemetry_cpu")}</th>
          <th className="py-1 pr-3 text-right font-normal">{text("telemetry_memory")}</th>
          <th className="py-1 text-right font-normal max-md:hidden">{text("telemetry_restarts")}</th>
        </tr>
      </thead>
      <tbody>
        {rows.map((row) => {
          const { label, icon: Icon, tone } = HEALTH[row.health];
          const isMeasured = row.health === "up" || row.health === "trouble" || row.health === "starting";
          return (
            <tr key={row.name} className="border-t border-line align-top">
              <th scope="row" className="py-2 pr-3 font-semibold">
                {row.name}
              </th>
              <td className="w-[55%] py-2 pr-3">
                <span className={cn("inline-flex items-center gap-2", tone)}>
                  <Icon aria-hidden="true" className="size-4 shrink-0" />
                  {text(label)}
                  {typeof row.waiting_s === "number" && <span className="text-xs text-text-3 numeric">{formatDuration(row.waiting_s)}</span>}
                </span>
                {row.remark !== "" && <span className="block text-xs break-words text-text-2">{row.remark}</span>}
              </td>
              <td className="py-2 pr-3 text-right whitespace-nowrap numeric">
                {isMeasured ? fixed(row.cpu_percent, 0) : UNKNOWN}
                <span className="text-xs text-text-3"> %</span>
              </td>
              <td className="py-2 pr-3 text-right whitespace-nowrap numeric">
                {isMeasured ? fixed(row.memory_mb, 0) : UNKNOWN}
                <span className="text-xs text-text-3"> MB</span>
              </td>
              <td className={cn("py-2 text-right numeric max-md:hidden", (row.restarts ?? 0) > 0 ? "text-attention" : "text-text-3")}>{row.restarts ?? 0}</td>
            </tr>
          );
        })}
      </tbody>
    </table>
  );
}

function RateTable({ rows }: { rows: readonly RateRow[] }) {
  const text = useText();
  return (
    <table className="w-full text-left">
      <thead className="sticky top-0 bg-panel text-xs text-text-3">
        <tr>
          <th className="py-1 pr-3 font-normal">{text("telemetry_topic")}</th>
          <th className="py-1 pr-3 text-right font-normal">{text("telemetry_hz")}</th>
          <th className="py-1 text-right font-normal">{text("telemetry_expected")}</th>
        </tr>
      </thead>
      <tbody>
        {rows.map(({ topic, hz, expectedHz, silentS, isSlow }) => (
          <tr key={topic} className="border-t border-line align-baseline">
            <th scope="row" className="max-w-0 py-1.5 pr-3 text-sm font-normal">
              <span className="block truncate numeric" title={topic}>
                {topic}
              </span>
              {silentS !== null && <span className="text-xs text-attention">{text("telemetry_silent", { age: formatDuration(silentS) })}</span>}
              {isSlow && <span className="text-xs text-attention">{text("telemetry_slow")}</span>}
            </th>
            <td className={cn("w-20 py-1.5 pr-3 text-right font-semibold numeric", (silentS !== null || isSlow) && "text-attention")}>{fixed(hz, 1)}</td>
            <td className="w-16 py-1.5 text-right text-text-3 numeric">{expectedHz === null ? UNKNOWN : fixed(expectedHz, expectedHz < 1 ? 1 : 0)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
