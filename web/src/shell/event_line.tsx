import { CircleCheck, Link2, Lock, ShieldAlert, ShieldCheck, TriangleAlert, Unplug } from "lucide-react";
import { useState } from "react";
import { useConsole } from "@/api/console_store";
import { useCanDrive } from "@/hooks/use_situation";
import { useIsPhone } from "@/hooks/use_is_phone";
import { useText } from "@/i18n/text";
import { useLink } from "@/robot/link";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { Dialog } from "@/ui/dialog";
import { UNKNOWN, fixed } from "@/ui/numbers";
import { LastEvent } from "./last_event";
import { showOverlay } from "@/state/overlays";

/** The foot of the page: whether the sticks would drive, the last event, and what the doctor found; on a phone, the link instead. */
export function EventLine() {
  const isPhone = useIsPhone();
  return (
    <footer className="flex min-h-(--foot) min-w-0 shrink-0 items-center gap-6 border-t border-line bg-ground/80 px-4 max-md:gap-3 max-md:px-3">
      <CanDrive />
      {isPhone ? (
        <LinkState />
      ) : (
        <>
          <LastEvent />
          <DoctorBadge />
        </>
      )}
    </footer>
  );
}

/** The link in one word. */
function LinkState() {
  const text = useText();
  const { state, lostMs, roundTripMs } = useLink();
  const isOpen = state === "open" && lostMs === null;
  return (
    <p data-testid="link-state" className={cn("ml-auto flex shrink-0 items-center gap-1.5 text-xs", isOpen ? "text-text-2" : "text-attention")}>
      {isOpen ? <Link2 aria-hidden="true" className="size-4" /> : <Unplug aria-hidden="true" className="size-4" />}
      <span className="sr-only">{text("link")}: </span>
      {isOpen ? <span className="numeric">{roundTripMs === null ? UNKNOWN : fixed(roundTripMs, 0)} ms</span> : text("link_none")}
    </p>
  );
}

export function CanDrive() {
  const text = useText();
  const { reasons, yes } = useCanDrive();
  const [isOpen, setOpen] = useState(false);
  const first = reasons[0];
  return (
    <>
      <button type="button" onClick={() => setOpen(true)} className="flex min-w-0 items-center gap-2 text-left max-md:min-h-11 max-md:text-xs">
        {first === undefined ? (
          <CircleCheck aria-hidden="true" className="size-4 shrink-0 text-alive" />
        ) : (
          <Lock aria-hidden="true" className="size-4 shrink-0 text-text-2" />
        )}
        {/* Two stops at once, or a long reason, take more than one line: the foot grows with them. */}
        <span className="py-1 leading-tight">
          <span className="text-text-3 max-md:sr-only">{text("can_i_drive")} </span>
          <strong className="font-semibold">
            {first === undefined ? text(yes) : text("can_drive_no", { reason: text(first.key, first.values) })}
          </strong>
        </span>
      </button>
      <Dialog open={isOpen} onOpenChange={setOpen} title={text("can_i_drive")}>
        {reasons.length === 0 ? (
          <p>{text(yes)}</p>
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
  const online = useConsole((state) => state.online);
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
    <Button kind="quiet" size="small" className={cn("ml-auto max-xl:h-9", !online && "text-text-3")} onClick={() => showOverlay(alarms > 0 ? "runs" : "doctor")}>
      <Icon className={online && (alarms > 0 || findings) ? "text-attention" : "text-text-3"} />
      {alarms > 0 ? text("alarms", { count: alarms }) : `${text("doctor")}: ${label}`}
    </Button>
  );
}
