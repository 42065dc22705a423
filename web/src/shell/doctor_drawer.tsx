import { CircleAlert, CircleCheck, CircleHelp, LoaderCircle } from "lucide-react";
import { type DoctorState, useConsole } from "@/api/console_store";
import { useNow } from "@/hooks/use_now";
import { type Text, useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { Dialog } from "@/ui/dialog";
import { formatDuration } from "@/ui/numbers";
import { VERDICTS, type Verdict, countsOf, verdictOf } from "./doctor/diagnosis";
import { FindingItem, Summary } from "./doctor/finding_item";
import { examine } from "@/api/doctor";
import { useOverlayState } from "@/state/overlays";

/** The doctor's findings, and their fixes. */
export default function DoctorDrawer() {
  const text = useText();
  const [isOpen, setOpen] = useOverlayState("doctor");
  const doctor = useConsole((state) => state.doctor);
  const { diagnosis } = doctor;
  return (
    <Dialog open={isOpen} onOpenChange={setOpen} title={text("doctor")} drawer className="md:w-[min(620px,calc(100vw-9rem))]">
      <div className="flex flex-col gap-4">
        <Head doctor={doctor} />
        {doctor.problem !== "" && (
          <p role="alert" className="rounded-md bg-attention-wash px-4 py-3 text-attention">
            {text("doctor_failed", { reason: doctor.problem })}
          </p>
        )}
        {diagnosis !== null && diagnosis.findings.length > 0 && (
          <ul className="flex flex-col gap-3">
            {diagnosis.findings.map((finding) => (
              <FindingItem key={`${finding.id} ${finding.where}`} finding={finding} />
            ))}
          </ul>
        )}
        {diagnosis !== null && (
          <>
            <Names title={text("doctor_not_examined")} names={diagnosis.unknown} open />
            <Names title={text("doctor_broken")} names={diagnosis.broken} open />
            <Names title={text("doctor_checks")} names={diagnosis.checks} />
          </>
        )}
      </div>
    </Dialog>
  );
}

const TONES: Record<Verdict, { icon: typeof CircleCheck; tone: string }> = {
  unknown: { icon: CircleHelp, tone: "text-text-3" },
  healthy: { icon: CircleCheck, tone: "text-alive" },
  warnings: { icon: CircleCheck, tone: "text-alive" },
  problems: { icon: CircleAlert, tone: "text-stop-text" },
  unreachable: { icon: CircleAlert, tone: "text-stop-text" },
  incomplete: { icon: CircleHelp, tone: "text-attention" },
};

function Head({ doctor }: { doctor: DoctorState }) {
  const text = useText();
  const verdict = verdictOf(doctor);
  const { icon: Icon, tone } = TONES[verdict];
  const busy = doctor.busy !== "";
  const now = (performance.timeOrigin + useNow()) / 1000;
  const age = doctor.examined_s === null ? null : Math.max(0, now - doctor.examined_s);
  return (
    <div className="flex flex-wrap items-start gap-3">
      {busy ? (
        <LoaderCircle aria-hidden="true" className="mt-1 size-7 shrink-0 animate-spin text-sensed" />
      ) : (
        <Icon aria-hidden="true" className={cn("mt-1 size-7 shrink-0", tone)} />
      )}
      <div className="min-w-0 grow basis-56" role="status">
        <p className="text-lead leading-tight font-bold">
          {busy && verdict === "unknown" ? busySentence(doctor.busy, text) : text(VERDICTS[verdict])}
        </p>
        <p className="text-text-2">{busy && verdict !== "unknown" ? busySentence(doctor.busy, text) : summary(doctor, text)}</p>
        {age !== null && <p aria-hidden="true" className="text-xs text-text-3">{text("doctor_examined", { age: formatDuration(age) })}</p>}
      </div>
      <Button kind={verdict === "unknown" ? "primary" : "plain"} disabled={busy} onClick={() => void examine()}>
        {text(doctor.diagnosis === null ? "doctor_examine" : "doctor_examine_again")}
      </Button>
    </div>
  );
}

function summary(doctor: DoctorState, text: Text): string {
  if (doctor.diagnosis === null) return text("doctor_not_asked_hint");
  const { problems, warnings, checks } = countsOf(doctor);
  return problems + warnings > 0 ? text("doctor_counts", { problems, warnings, checks }) : text("doctor_clean", { checks });
}

function busySentence(busy: string, text: Text): string {
  if (busy === "examining") return text("doctor_examining");
  const [what = "", playbook = ""] = busy.split(" ");
  return `${text(what === "playing" ? "doctor_playing" : "doctor_previewing")}: ${playbook}`;
}

function Names({ title, names, open = false }: { title: string; names: readonly string[]; open?: boolean }) {
  if (names.length === 0) return null;
  return (
    <details open={open} className="group">
      <Summary>
        {title} <span className="text-text-3 numeric">{names.length}</span>
      </Summary>
      <ul className="grid gap-x-6 gap-y-1 text-xs text-text-2 md:grid-cols-2">
        {names.map((name) => (
          <li key={name} className="truncate numeric">
            {name}
          </li>
        ))}
      </ul>
    </details>
  );
}
