import { TriangleAlert } from "lucide-react";
import { Suspense } from "react";
import { create } from "zustand";
import { useConsole } from "@/api/console_store";
import { useText } from "@/i18n/text";
import { deferred } from "@/ui/deferred";
import { Segments } from "@/ui/segments";
import { ReadingsView } from "./readings_view";
import { RunView } from "./run_view";

const PlotsView = deferred(() => import("./plots/plots_view"));

type View = "readings" | "plots" | "run";
const VIEWS: readonly View[] = ["readings", "plots", "run"];

/** Kept while other tabs are shown. */
const useView = create<{ view: View }>(() => ({ view: "readings" }));

/** The Telemetry tab: readable numbers first, plots of any field, and the run's processes. */
export default function TelemetryTab() {
  const text = useText();
  const view = useView((state) => state.view);
  const alarms = useConsole((state) => state.run.alarms?.length ?? 0);
  return (
    <div className="flex min-h-full flex-col gap-3 xl:h-full xl:min-h-[38rem]">
      <div className="flex flex-wrap items-center gap-4">
        <Segments
          label={text("telemetry_view")}
          value={view}
          options={VIEWS.map((value) => ({ value, label: text(`telemetry_view_${value}`) }))}
          onChange={(next) => useView.setState({ view: next })}
        />
        {alarms > 0 && view !== "run" && (
          <button type="button" onClick={() => useView.setState({ view: "run" })} className="flex min-h-11 items-center gap-2 text-sm text-attention">
            <TriangleAlert aria-hidden="true" className="size-4" />
            {text("alarms", { count: alarms })}
          </button>
        )}
      </div>
      {view === "readings" && <ReadingsView />}
      {view === "run" && <RunView />}
      {view === "plots" && (
        <Suspense fallback={<p className="p-4 text-text-2">{text("loading")}</p>}>
          <PlotsView />
        </Suspense>
      )}
    </div>
  );
}
