import { CircleCheck, Lock, ShieldAlert, ShieldCheck, TriangleAlert } from "lucide-react";
import { useState } from "react";
import { useConsole } from "@/api/console_store";
import { useDriveObstacles } from "@/hooks/use_situation";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { LastEvent } from "./last_event";
import { showOverlay } from "./overlays";

/** The foot of the page: whether the sticks would drive, the last event, and what the doctor found. */
export function EventLine() {
  return (
    <footer className="flex h-(--foot) min-w-0 items-center gap-6 border-t border-line bg-ground/80 px-4 max-md:hidden">
      <CanDrive />
      <LastEvent />
      <DoctorBadge />
    </footer>
  );
}

export function CanDrive() {
  const text = useText();
  const reasons = useDriveObstacles();
  const [isOpen, setOpen] = useState(false);
  const first = reasons[0];
  return (
    <>
      <button type="button" onClick={() => setOpen(true)} className="flex min-w-0 items-center gap-2 text-left">
        {first === undefined ? (
          <CircleCheck aria-hidden="true" className="size-4 shrink-0 text-alive" />
        ) : (
          <Lock aria-hidden="true" className="size-4 shrink-0 text-text-2" />
        )}
        <span className="truncate">
          <span className="text-text-3">{text("can_i_drive")} </span>
          <strong className="font-semibold">
            {first === undefined ? text("can_drive_yes") : text("can_drive_no", { reason: text(first.key, first.values) })}
          </strong>
        </span>
      </button>
      <Dialog open={isOpen} onOpenChange={setOpen} title={text("can_i_drive")}>
        {reasons.length === 0 ? (
          <p>{text("can_drive_yes")}</p>
        ) : (
          <ul className="flex list-disc flex-col gap-2 pl-5 text-base">
            {reasons.map((reason) => (
              <li key={reason.key}>{text(reason.key, reason.values)}</li>
            ))}
          </ul>
        )}
      </Dialog>
    </>
  );
}

function DoctorBadge() {
  const text = useText();
  const doctor = useConsole((state) => state.doctor);
  const alarms = useConsole((state) => state.run.alarms?.length ?? 0);
  const findings = doctor.diagnosis?.findings.length ?? null;
  const label =
    doctor.busy !== ""
      ? text("doctor_busy")
      : findings === null
        ? text("doctor_none")
        : findings === 0
          ? text("doctor_healthy")
          : text("doctor_findings", { count: findings });
  const Icon = alarms > 0 ? TriangleAlert : findings ? ShieldAlert : ShieldCheck;
  return (
    <Button kind="quiet" size="small" className="ml-auto max-xl:h-9" onClick={() => showOverlay(alarms > 0 ? "runs" : "doctor")}>
      <Icon className={alarms > 0 || findings ? "text-attention" : "text-text-3"} />
      {alarms > 0 ? text("alarms", { count: alarms }) : `${text("doctor")}: ${label}`}
    </Button>
  );
}
