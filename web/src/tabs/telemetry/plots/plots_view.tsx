import { ChartLine, Pause, Play, Plus, X } from "lucide-react";
import { useCallback, useEffect, useState } from "react";
import { useNow } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed, formatDuration } from "@/ui/numbers";
import { Segments } from "@/ui/segments";
import { cssColor } from "@/widgets/canvas";
import type { TimeSeries } from "@/widgets/time_series";
import { FieldPicker } from "./field_picker";
import { PlotCanvas } from "./plot_canvas";
import { type PlotMode, type PlotSeries, STYLES, type StarterName, WINDOWS_S, addSeries, removeSeries, starterFields, usePlots } from "./plot_store";
import { PlotRecorder } from "./recorder";

const STARTERS: readonly StarterName[] = ["speed", "turn", "voltage", "arm"];
const MODES: readonly PlotMode[] = ["stacked", "together"];
/** A field without a sample for this long is called silent. */
const SILENT_S = 3;

interface Pause {
  atS: number;
  samples: Map<string, TimeSeries>;
}

/** Plots of numeric fields of any topic. */
export default function PlotsView() {
  const text = useText();
  const { series, mode, windowS } = usePlots();
  const [recorder] = useState(() => new PlotRecorder());
  const [pause, setPause] = useState<Pause | null>(null);
  const [isPicking, setPicking] = useState(false);

  useEffect(() => recorder.record(series), [recorder, series]);
  useEffect(() => () => recorder.stop(), [recorder]);

  const samplesOf = useCallback((id: string) => (pause === null ? recorder.samples(id) : (pause.samples.get(id) ?? null)), [recorder, pause]);

  function togglePause(): void {
    if (pause !== null) return setPause(null);
    const samples = new Map<string, TimeSeries>();
    for (const { id } of series) {
      const recorded = recorder.samples(id);
      if (recorded !== null) samples.set(id, recorded.copy());
    }
    setPause({ atS: performance.now() / 1000, samples });
  }

  const groups = mode === "together" ? [series] : series.map((each) => [each]);
  return (
    <div className="flex min-h-[30rem] grow flex-col gap-3 xl:min-h-0">
      <div className="flex flex-wrap items-center gap-2">
        <Button onClick={() => setPicking(true)}>
          <Plus />
          {text("telemetry_add")}
        </Button>
        <Button onClick={togglePause} disabled={series.length === 0} aria-pressed={pause !== null}>
          {pause === null ? <Pause /> : <Play />}
          {text(pause === null ? "telemetry_pause" : "telemetry_resume")}
        </Button>
        <Segments label={text("telemetry_mode")} value={mode} options={MODES.map((value) => ({ value, label: text(`telemetry_mode_${value}`) }))} onChange={(value) => usePlots.setState({ mode: value })} />
        <Segments
          label={text("telemetry_window")}
          value={String(windowS)}
          options={WINDOWS_S.map((seconds) => ({ value: String(seconds), label: seconds < 120 ? `${seconds} s` : `${seconds / 60} min` }))}
          onChange={(value) => usePlots.setState({ windowS: Number(value) })}
        />
        {pause !== null && <PausedSince atS={pause.atS} />}
      </div>
      {series.length === 0 ? (
        <Empty />
      ) : (
        groups.map((group) => (
          <section key={group.map(({ id }) => id).join()} aria-label={group.map(({ path }) => path).join(", ")} className="panel flex min-h-48 grow basis-0 flex-col">
            <ul className="flex flex-wrap gap-x-6 px-4 pt-2">
              {group.map((each) => (
                <Legend key={each.id} series={each} samplesOf={samplesOf} isPaused={pause !== null} />
              ))}
            </ul>
            <div className="relative min-h-32 grow">
              <PlotCanvas label={text("telemetry_plot_alt", { fields: group.map(({ path }) => path).join(", ") })} series={group} samplesOf={samplesOf} windowS={windowS} pausedS={pause?.atS ?? null} withTimes />
            </div>
          </section>
        ))
      )}
      {isPicking && <FieldPicker onClose={() => setPicking(false)} />}
    </div>
  );
}

function PausedSince({ atS }: { atS: number }) {
  const text = useText();
  const nowMs = useNow();
  return (
    <p role="status" className="text-sm text-attention">
      {text("telemetry_paused", { age: formatDuration(Math.max(0, nowMs / 1000 - atS)) })}
    </p>
  );
}

/** A field with its line, its newest value, and how long it has been silent. */
function Legend({ series, samplesOf, isPaused }: { series: PlotSeries; samplesOf: (id: string) => TimeSeries | null; isPaused: boolean }) {
  const text = useText();
  const nowMs = useNow();
  const samples = samplesOf(series.id);
  const { color, dash } = STYLES[series.style % STYLES.length] ?? { color: "--color-text", dash: [] };
  const silentS = samples === null || samples.size === 0 ? null : nowMs / 1000 - samples.lastTime;
  const isSilent = !isPaused && silentS !== null && silentS > SILENT_S;
  return (
    <li className="flex min-h-9 min-w-0 items-center gap-2.5">
      <svg viewBox="0 0 28 4" aria-hidden="true" className="h-1 w-7 shrink-0">
        <line x1="0" x2="28" y1="2" y2="2" stroke={cssColor(color)} strokeWidth="3" strokeDasharray={dash.join(" ")} />
      </svg>
      <span className="min-w-0 truncate text-sm">
        <span className="font-semibold numeric">{series.path}</span>
        <span className="ml-2 text-xs text-text-3 numeric">{series.topic}</span>
      </span>
      <span className={cn("text-base font-semibold whitespace-nowrap tabular-nums slashed-zero", isSilent && "text-text-3")}>{fixed(samples?.lastValue, 3)}</span>
      {samples?.size === 0 && <span className="text-xs text-text-3">{text("telemetry_no_sample")}</span>}
      {isSilent && <span className="text-xs whitespace-nowrap text-attention">{text("telemetry_silent", { age: formatDuration(silentS) })}</span>}
      <Button kind="quiet" size="icon" aria-label={text("telemetry_remove", { field: series.path })} onClick={() => removeSeries(series.id)}>
        <X />
      </Button>
    </li>
  );
}

function Empty() {
  const text = useText();
  return (
    <section className="panel grid grow place-items-center p-8 text-center">
      <div className="flex max-w-lg flex-col items-center gap-4">
        <ChartLine aria-hidden="true" className="size-10 text-text-3" />
        <p className="text-base text-text-2">{text("telemetry_plots_empty")}</p>
        <div className="flex flex-wrap justify-center gap-2">
          {STARTERS.map((name) => (
            <Button key={name} onClick={() => addSeries(starterFields(name))}>
              {text(`telemetry_starter_${name}`)}
            </Button>
          ))}
        </div>
      </div>
    </section>
  );
}
