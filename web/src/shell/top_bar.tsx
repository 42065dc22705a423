import { BatteryFull, BatteryLow, BatteryMedium, BatteryWarning, Search, Settings2 } from "lucide-react";
import { useState } from "react";
import { hasControl, useConsole } from "@/api/console_store";
import { useNow } from "@/hooks/use_now";
import { useBattery, useMission, useSentence } from "@/hooks/use_situation";
import { useTopic } from "@/hooks/use_topic";
import { TOPICS } from "@/generated/graph";
import { type TextKey, useLanguage, useText } from "@/i18n/text";
import { useLink } from "@/robot";
import { progress } from "@/state/sentence";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { UNKNOWN, clock, fixed } from "@/ui/numbers";
import { ControlDialog } from "./control_dialog";
import { showOverlay } from "./overlays";

const PHASES: Record<string, TextKey> = {
  PREPARE: "phase_preparing",
  EXPLORING: "phase_exploring",
  INSPECTING: "phase_inspecting",
  MONITORING: "phase_monitoring",
  RETURNING: "phase_returning",
};

export function TopBar() {
  const text = useText();
  return (
    <header className="flex h-(--bar) min-w-0 items-center gap-4 border-b border-line bg-ground/80 px-4 max-md:gap-3 max-md:px-3">
      <Logo />
      <MissionStrip />
      <div className="ml-auto flex shrink-0 items-center gap-5 max-lg:gap-3">
        <ControlPill />
        <LinkReading />
        <BatteryReading />
        <RobotTime />
        <Button
          kind="quiet"
          size="icon"
          aria-label={text("palette")}
          title={`${text("palette")} (${text("palette_hint")})`}
          onClick={() => showOverlay("palette")}
          className="-mr-3 max-lg:hidden"
        >
          <Search />
        </Button>
        <Button kind="quiet" size="icon" aria-label={text("settings")} onClick={() => showOverlay("settings")}>
          <Settings2 />
        </Button>
      </div>
    </header>
  );
}

function Logo() {
  return (
    <div className="flex shrink-0 items-center gap-2 border-line pr-4 max-md:hidden md:border-r">
      <img src={`${import.meta.env.BASE_URL}lupin.svg`} alt="" className="size-8" />
      <span className="text-lead font-bold max-xl:hidden">Lupin</span>
    </div>
  );
}

function MissionStrip() {
  const text = useText();
  const { key, values, tone } = useSentence();
  const mission = useMission();
  const count = progress(mission);
  const now = useNow();
  const state = mission?.lifecycle_state ?? "";
  const phase = PHASES[state];
  return (
    <div className="flex min-w-0 items-center gap-4" role="status" aria-live="polite">
      <p
        className={cn(
          "truncate text-lead font-bold max-md:text-base",
          tone === "stop" && "text-stop-text",
          tone === "attention" && "text-attention",
          tone === "lost" && "text-text-2",
        )}
      >
        {text(key, values)}
      </p>
      {count !== null && <Segments done={count.done} total={count.total} />}
      {count !== null && (
        <p className="flex items-baseline gap-1.5 whitespace-nowrap max-md:hidden">
          <span className="text-lead font-bold numeric">{count.done}</span>
          <span className="text-sm text-text-3">{text("of_total", { total: count.total })}</span>
        </p>
      )}
      {phase !== undefined && mission !== null && (
        <p className="whitespace-nowrap text-text-2 max-xl:hidden">
          {text(phase)} · <span className="numeric">{missionAge(mission.started_at.sec, mission.header.stamp.sec, now)}</span>
        </p>
      )}
    </div>
  );
}

function missionAge(startedS: number, stampS: number, _now: number): string {
  return startedS > 0 && stampS >= startedS ? clock(stampS - startedS) : UNKNOWN;
}

/** One mark per tag, so that "11 of 12" is seen from afar. */
function Segments({ done, total }: { done: number; total: number }) {
  if (total > 40) return null;
  return (
    <div aria-hidden="true" className="flex gap-0.5 max-lg:hidden">
      {Array.from({ length: total }, (_, index) => (
        <span
          key={index}
          className={cn(
            "h-4 w-2.5 rounded-[2px] border",
            index < done ? "border-alive-2 bg-alive-2" : index === done ? "border-alive bg-alive" : "border-line-strong",
          )}
        />
      ))}
    </div>
  );
}

function ControlPill() {
  const text = useText();
  const state = useConsole();
  const [isOpen, setOpen] = useState(false);
  const mine = hasControl(state);
  const holder = state.control.holder;
  const label = mine
    ? text("you_have_control")
    : holder !== null
      ? text("other_has_control", { holder })
      : state.own?.role === "viewer"
        ? text("you_are_viewer")
        : text("nobody_has_control");
  const since = state.control.since_s === null ? null : new Date(state.control.since_s * 1000).toLocaleTimeString();
  return (
    <>
      <button
        type="button"
        onClick={() => setOpen(true)}
        className={cn(
          "flex min-h-11 items-center gap-2.5 rounded-full border px-4 py-1 text-left",
          mine ? "border-alive-2 bg-alive-wash" : "border-line-strong bg-raised",
        )}
      >
        <span aria-hidden="true" className={cn("size-2.5 shrink-0 rounded-full", mine ? "bg-alive" : holder !== null ? "bg-attention" : "bg-text-3")} />
        <span className="max-md:sr-only">
          <span className="block text-sm leading-tight font-semibold">{label}</span>
          {since !== null && <span className="block text-xs leading-tight text-text-3 numeric">{text("control_since", { time: since })}</span>}
        </span>
      </button>
      <ControlDialog open={isOpen} onOpenChange={setOpen} />
    </>
  );
}

function Reading({ value, unit, label, tone }: { value: string; unit: string; label: string; tone?: "attention" | "lost" }) {
  return (
    <div className="max-md:hidden">
      <p className={cn("text-sm leading-tight font-semibold whitespace-nowrap", tone === "attention" && "text-attention", tone === "lost" && "text-text-3")}>
        <span className="numeric">{value}</span> {unit}
      </p>
      <p className="text-xs leading-tight text-text-3">{label}</p>
    </div>
  );
}

function LinkReading() {
  const text = useText();
  const { state, roundTripMs } = useLink();
  const known = state === "open" && roundTripMs !== null;
  return <Reading value={known ? fixed(roundTripMs, 0) : UNKNOWN} unit={known ? "ms" : ""} label={text("link")} tone={known ? undefined! : "lost"} />;
}

function BatteryReading() {
  const text = useText();
  const sample = useBattery();
  const fraction = sample?.message.percentage ?? NaN;
  const percent = Number.isFinite(fraction) ? fraction * 100 : null;
  const Icon = percent === null || percent > 60 ? BatteryFull : percent > 30 ? BatteryMedium : percent > 15 ? BatteryLow : BatteryWarning;
  const low = percent !== null && percent <= 30;
  return (
    <div className="flex items-center gap-2">
      <Icon aria-hidden="true" className={cn("size-6", percent === null ? "text-text-3" : low ? "text-attention" : "text-alive")} />
      <div>
        <p className={cn("text-sm leading-tight font-semibold whitespace-nowrap", low && "text-attention")}>
          <span className="sr-only">{text("battery")}: </span>
          <span className="numeric">{percent === null ? UNKNOWN : fixed(percent, 0)}</span> %
        </p>
        <p className="text-xs leading-tight whitespace-nowrap text-text-3 numeric max-md:hidden">{fixed(sample?.message.voltage, 2)} V</p>
      </div>
    </div>
  );
}

/** The robot's clock, from the mission's stamps or, without a mission, from the last ping: a wrong clock is seen here. */
function RobotTime() {
  const text = useText();
  const language = useLanguage((state) => state.language);
  const state = useTopic(TOPICS.MISSION_STATE);
  const isOpen = useLink((link) => link.state === "open");
  const offsetS = useLink((link) => link.clockOffsetS);
  const now = useNow();
  const pinged = !isOpen || offsetS === null ? null : Math.floor(now / 1000 + offsetS);
  const seconds = state?.message.header.stamp.sec ?? pinged;
  const value =
    seconds === null ? UNKNOWN : seconds > 1e9 ? new Date(seconds * 1000).toLocaleTimeString(language) : clock(seconds);
  return <Reading value={value} unit="" label={text("robot_time")} />;
}
