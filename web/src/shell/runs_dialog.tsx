import { Download, FileText } from "lucide-react";
import { type ReactNode, useState } from "react";
import { type Text, useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { CommandLine } from "@/ui/command_line";
import { Dialog } from "@/ui/dialog";
import { UNKNOWN, dayAndTime } from "@/ui/numbers";
import { useOverlayState } from "@/state/overlays";
import { CurrentRun } from "./runs/current_run";
import { ReportView } from "./runs/report_view";
import { type Play, type StoredRun, endedWell, megabytes, parsePlays, parseRuns } from "./runs/run_lists";
import { type Answer, useAnswer } from "./runs/use_answer";

/** What runs now, what ran before with its reports, and what playbooks changed. */
export default function RunsDialog() {
  const text = useText();
  const [isOpen, setOpen] = useOverlayState("runs");
  const [report, setReport] = useState<string | null>(null);
  return (
    <Dialog
      open={isOpen}
      onOpenChange={(open) => {
        setReport(null);
        setOpen(open);
      }}
      title={report === null ? text("runs_title") : text("runs_report_title", { run: report })}
      className={report === null ? "w-[min(760px,calc(100vw-1.5rem))]" : "w-[min(1100px,calc(100vw-var(--stop)-1.5rem))] max-md:w-[calc(100vw-1.5rem)]"}
    >
      {isOpen && (report === null ? <Lists onReport={setReport} /> : <ReportView run={report} onBack={() => setReport(null)} />)}
    </Dialog>
  );
}

function Lists({ onReport }: { onReport: (run: string) => void }) {
  const text = useText();
  const runs = useAnswer("/_api/runs", parseRuns);
  const plays = useAnswer("/_api/plays", parsePlays);
  const deployments = useAnswer("/_api/deployments", parsePlays);
  return (
    <div className="flex flex-col gap-6">
      <CurrentRun />
      <List title={text("runs_stored")} empty={text("runs_stored_none")} answer={runs}>
        {(run) => <RunRow key={run.id} run={run} onReport={() => onReport(run.id)} />}
      </List>
      <List title={text("runs_deployments")} empty={text("runs_deployments_none")} answer={deployments}>
        {(play) => <PlayRow key={play.run} play={play} />}
      </List>
      <List title={text("runs_plays")} empty={text("runs_plays_none")} answer={plays}>
        {(play) => <PlayRow key={play.run} play={play} />}
      </List>
    </div>
  );
}

function List<Row>({ title, empty, answer, children }: { title: string; empty: string; answer: Answer<Row[]>; children: (row: Row) => ReactNode }) {
  const text = useText();
  return (
    <section aria-label={title} className="flex flex-col gap-1">
      <h3 className="text-sm font-semibold text-text-2">{title}</h3>
      {answer.problem !== "" ? (
        <p role="alert" className="text-attention">
          {text("runs_failed", { reason: answer.problem })}
        </p>
      ) : answer.value === null ? (
        <p className="text-text-3">{text("loading")}</p>
      ) : answer.value.length === 0 ? (
        <p className="text-text-3">{empty}</p>
      ) : (
        <ul>{answer.value.map(children)}</ul>
      )}
    </section>
  );
}

function RunRow({ run, onReport }: { run: StoredRun; onReport: () => void }) {
  const text = useText();
  const isUp = run.state === "up";
  return (
    <li className="flex min-h-11 flex-wrap items-center gap-x-4 gap-y-1 border-t border-line py-1">
      <span className="min-w-0 grow basis-40">
        <span className="block truncate numeric">{run.id}</span>
        <span className="block text-xs text-text-3">
          <Moment date={run.startedS === null ? null : new Date(run.startedS * 1000)} />
          {run.kept && ` · ${text("runs_kept")}`}
        </span>
      </span>
      <span className={cn("w-24", endedWell(run.state) ? "text-text-2" : "text-attention")}>{isUp ? text("runs_state_up") : run.state || UNKNOWN}</span>
      <span className="w-20 text-right whitespace-nowrap">
        <span className="numeric">{megabytes(run.sizeBytes)}</span> <span className="text-xs text-text-3">MB</span>
      </span>
      <span className="flex gap-1">
        <Button size="small" disabled={isUp} onClick={onReport}>
          <FileText />
          {text("runs_report")}
        </Button>
        <Button size="small" kind="quiet" asChild>
          <a href={`/_api/runs/${encodeURIComponent(run.id)}/recording`} download aria-label={`${text("runs_recording")} ${run.id}`}>
            <Download />
          </a>
        </Button>
      </span>
    </li>
  );
}

function PlayRow({ play }: { play: Play }) {
  const text = useText();
  return (
    <li className="flex min-h-11 flex-wrap items-center gap-x-4 gap-y-1 border-t border-line py-1.5">
      <span className="min-w-0 grow basis-40">
        <span className="block font-semibold">{play.playbook}</span>
        <span className="block text-xs text-text-3">
          {robotLabel(play, text)} · <Moment date={play.started} />
        </span>
      </span>
      <span className={endedWell(play.state) ? "text-text-2" : "text-attention"}>{play.state}</span>
      {play.resume !== "" && (
        <div className="flex w-full flex-wrap items-center gap-2 text-xs text-text-3">
          {text("runs_resume")} <CommandLine command={play.resume} />
        </div>
      )}
    </li>
  );
}

function robotLabel(play: Play, text: Text): string {
  return play.robot === "" ? text("runs_this_computer") : play.robot;
}

function Moment({ date }: { date: Date | null }) {
  return <span className="numeric">{date === null ? UNKNOWN : dayAndTime(date)}</span>;
}
