import { Check, CircleDashed, LoaderCircle } from "lucide-react";
import { useCallback, useEffect, useState } from "react";
import { TOPICS } from "@/generated/graph";
import { useNow } from "@/hooks/use_now";
import { useEstop } from "@/hooks/use_situation";
import { useTopic } from "@/hooks/use_topic";
import { type Text, useText } from "@/i18n/text";
import { useLink } from "@/robot/link";
import { useSetting } from "@/state/settings";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed } from "@/ui/numbers";
import { type Instrument, type Milestone, type MilestoneName, isLive, milestones } from "./boot/milestones";
import { DoctorButton } from "@/widgets/doctor_button";

const KEY = "lupin-booted";
/** A faster start shows no boot sequence. */
const SHOWN_AFTER_MS = 2000;
/** The boot sequence covers the console no longer than this. */
const WATCHDOG_MS = 8000;
/** The last tick is seen before the console is. */
const LINGERS_MS = 500;

const NAMES = { link: "boot_link", handshake: "boot_handshake", telemetry: "boot_telemetry", live: "boot_live" } as const;

/** Shows which parts of the robot have answered so far; once per browser session, and only if the start takes long. */
export function BootSequence() {
  const [isOver, setOver] = useState(wasSeen);
  // Always the same function: another one would begin the wait for its call again.
  const end = useCallback(() => {
    remember();
    setOver(true);
  }, []);
  return isOver ? null : <Sequence onEnd={end} />;
}

function Sequence({ onEnd }: { onEnd: () => void }) {
  const text = useText();
  const steps = useMilestones();
  const times = useTimes(steps);
  const now = useNow();
  // All four were ticked; a link that is lost right then does not bring the screen back.
  const [live, setLive] = useState(false);
  if (!live && isLive(steps)) setLive(true);
  const shown = now > SHOWN_AFTER_MS;

  useEffect(() => {
    if (!live) return;
    const timer = setTimeout(onEnd, performance.now() > SHOWN_AFTER_MS ? LINGERS_MS : 0);
    return () => clearTimeout(timer);
  }, [live, onEnd]);

  useEffect(() => {
    const timer = setTimeout(onEnd, Math.max(0, WATCHDOG_MS - performance.now()));
    return () => clearTimeout(timer);
  }, [onEnd]);

  if (!shown) return null;
  const current = steps.findIndex(({ reached }) => !reached);
  return (
    <div
      role="dialog"
      aria-label={text("boot_title")}
      className="fixed inset-0 right-(--stop) z-30 grid place-items-center overflow-y-auto bg-ground/97 p-6 max-md:right-0 max-md:bottom-[calc(var(--stop)+var(--tabs))]"
    >
      <div className="flex w-full max-w-2xl flex-col gap-6">
        <div className="flex items-center gap-5">
          <img src={`${import.meta.env.BASE_URL}lupin.svg`} alt="" className="size-16" />
          <div>
            <p className="text-2xl leading-tight font-bold">Lupin</p>
            <p className="text-base text-text-2">{text("boot_title")}</p>
          </div>
        </div>
        <ol aria-live="polite" className="border-t border-line-strong">
          {steps.map((step, index) => (
            <li
              key={step.name}
              className={cn("flex min-h-13 items-center gap-4 border-b border-line-strong text-base", index > current && current >= 0 && "text-text-3")}
            >
              <Icon state={step.reached ? "reached" : index === current ? "current" : "later"} />
              <span className="w-32 shrink-0 font-semibold max-md:w-24">{text(NAMES[step.name])}</span>
              <span className="min-w-0 grow text-text-2">{detailOf(step, text)}</span>
              <Elapsed ms={times[step.name]} />
            </li>
          ))}
        </ol>
        <div className="flex flex-wrap gap-3">
          <DoctorButton />
          <Button kind="quiet" onClick={onEnd}>
            {text("boot_skip")}
          </Button>
        </div>
      </div>
    </div>
  );
}

function Elapsed({ ms }: { ms: number | undefined }) {
  return <span className="shrink-0 text-text-3 numeric">{ms === undefined ? "" : `${fixed(ms / 1000, 2)} s`}</span>;
}

function Icon({ state }: { state: "reached" | "current" | "later" }) {
  if (state === "reached") return <Check aria-hidden="true" className="size-5 shrink-0 text-alive" />;
  if (state === "current") return <LoaderCircle aria-hidden="true" className="size-5 shrink-0 animate-spin text-sensed" />;
  return <CircleDashed aria-hidden="true" className="size-5 shrink-0 text-text-3" />;
}

function detailOf({ detail, values, instruments = [] }: Milestone, text: Text): string {
  return text(detail, { ...values, what: instruments.map((instrument) => text(`boot_${instrument}`)).join(", ") });
}

function useMilestones(): Milestone[] {
  const link = useLink();
  const estop = useEstop();
  const odometry = useTopic({ name: useSetting("odomTopic"), type: TOPICS.ODOM.type }, { throttleMs: 50 });
  const scan = useTopic({ name: useSetting("scanTopic"), type: TOPICS.SCAN.type });
  const battery = useTopic({ name: useSetting("batteryTopic"), type: TOPICS.BATTERY.type });
  const joints = useTopic({ name: useSetting("jointStatesTopic"), type: TOPICS.JOINT_STATES.type }, { throttleMs: 100 });
  const heard = new Map<Instrument, number>();
  if (odometry !== undefined) heard.set("odometry", odometry.receivedMs);
  if (scan !== undefined) heard.set("lidar", scan.receivedMs);
  if (battery !== undefined) heard.set("battery", battery.receivedMs);
  if (joints !== undefined) heard.set("joints", joints.receivedMs);
  if (estop.receivedMs !== null) heard.set("estop", estop.receivedMs);
  return milestones({ linkMs: link.state === "open" ? link.changedMs : null, roundTripMs: link.roundTripMs, heard });
}

/** When each milestone was reached first, ms after the page was opened: later samples do not move it. */
function useTimes(steps: readonly Milestone[]): Partial<Record<MilestoneName, number>> {
  const [times, setTimes] = useState<Partial<Record<MilestoneName, number>>>({});
  const news = steps.filter(({ name, atMs }) => atMs !== null && times[name] === undefined);
  if (news.length > 0) setTimes({ ...times, ...Object.fromEntries(news.map(({ name, atMs }) => [name, atMs])) });
  return times;
}

function wasSeen(): boolean {
  try {
    return sessionStorage.getItem(KEY) !== null;
  } catch {
    return false;
  }
}

function remember(): void {
  try {
    sessionStorage.setItem(KEY, "1");
  } catch {
    // Storage is forbidden: the next slow start shows it again.
  }
}
