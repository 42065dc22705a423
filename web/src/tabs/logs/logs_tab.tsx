import { create } from "zustand";
import { useText } from "@/i18n/text";
import { Segments } from "@/ui/segments";
import { JournalView } from "./journal_view";
import { LiveView } from "./live_view";
import { ProcessView } from "./process_view";

type View = "live" | "processes" | "commands";
const VIEWS: readonly View[] = ["live", "processes", "commands"];

/** Kept while other tabs are shown. */
const useView = create<{ view: View }>(() => ({ view: "live" }));

/** The Logs tab: the robot's log, the log files of the run's processes, and the command journal. */
export default function LogsTab() {
  const text = useText();
  const view = useView((state) => state.view);
  return (
    <div className="flex h-full min-h-[32rem] flex-col gap-3">
      <Segments
        label={text("logs_view")}
        value={view}
        options={VIEWS.map((value) => ({ value, label: text(`logs_view_${value}`) }))}
        onChange={(next) => useView.setState({ view: next })}
        className="self-start"
      />
      {view === "live" && <LiveView />}
      {view === "processes" && <ProcessView />}
      {view === "commands" && <JournalView />}
    </div>
  );
}
