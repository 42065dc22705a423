import { BatteryFull, BatteryMedium, BatteryWarning, Copy, Eye, Search, Settings2, UserCheck, UserLock, UserRound } from "lucide-react";
import { useState } from "react";
import { hasControl, otherBrowsers, useConsole } from "@/api/console_store";
import { useAge, useNow } from "@/hooks/use_now";
import { BATTERY_STALE_MS, useBattery, useIsControlStale, useIsLinkLost, useMission, useMissionSilence, useSentence } from "@/hooks/use_situation";
import { type Text, type TextKey, useText } from "@/i18n/text";
import { useLink } from "@/robot/link";
import { useTabRole } from "@/safety/commanding_tab";
import { type Charge, chargeOf, chargeShare } from "@/state/battery";
import { progress } from "@/state/sentence";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { UNKNOWN, clock, fixed, formatDuration, timeOfDay, writeMoment } from "@/ui/numbers";
import { ControlDialog, controlText } from "./control_dialog";
import { showOverlay } from "@/state/overlays";

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
        <div className="max-lg:hidden">
          <RobotTime />
        </div>
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
    <div className="flex shrink-0 items-center gap-2 border-line pr-4 max-lg:hidden lg:border-r">
      <img src={`${import.meta.env.BASE_URL}lupin.svg`} alt="" className="size-8" />
      <span className="text-lead font-bold max-xl:hidden">Lupin</span>
    </div>
  );
}

function MissionStrip() {
  const text = useText();
  const { key, values, tone } = useSentence();
  const lastMission = useMission();
  const mission = useIsLinkLost() ? null : lastMission;
  const count = progress(mission);
  const silentSinceMs = useMissionSilence();
  const state = mission?.lifecycle_state ?? "";
  const phase = PHASES[state];
  return (
    <div className="flex min-w-0 items-center gap-4">
      <p
        role="status"
        data-testid="sentence"
        className={cn(
          "line-clamp-2 text-lead leading-tight font-bold max-[1400px]:text-base",
          tone === "stop" && "text-stop-text",
          tone === "attention" && "text-attention",
          tone === "lost" && "text-text-2",
        )}
      >
        {text(key, values)}
        {key === "mission_is_silent" && <Silence sinceMs={silentSinceMs} />}
      </p>
      {count !== null && <Segments done={count.done} total={count.total} />}
      {count !== null && (
        <p className="flex items-baseline gap-1.5 whitespace-nowrap max-md:hidden">
          <span className="text-lead font-bold numeric">{count.done}</span>
          <span className="text-sm text-text-3">{text("of_total", { total: count.total })}</span>
        </p>
      )}
      {phase !== undefined && mission !== null && (
        <p className="whitespace-nowrap text-text-2 max-[1400px]:hidden">
          {text(phase)} · <span className="numeric">{missionAge(mission.started_at.sec, mission.header.stamp.sec)}</span>
        </p>
      )}
    </div>
  );
}

/** How long nothing has come; not read out, as it changes all the time. */
function Silence({ sinceMs }: { sinceMs: number | null }) {
  return (
    <span aria-hidden="true" className="ml-2 font-normal numeric">
      {formatDuration(useAge(sinceMs))}
    </span>
  );
}

function missionAge(startedS: number, stampS: number): string {
  return startedS > 0 && stampS >= startedS ? clock(stampS - startedS) : UNKNOWN;
}

/** One mark per tag, so that "11 of 12" can be read from a distance. */
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
  const isWatching = useTabRole(({ role }) => role === "watching");
  const mine = hasControl(state) && !isWatching;
  const isStale = useIsControlStale();
  const holder = state.control.holder;
  const { icon: Icon, label, short } = controlLabel(text, { isStale, isWatching: isWatching && hasControl(state), mine, holder, isViewer: state.session?.role === "viewer" });
  const others = otherBrowsers(state);
  const since = state.control.since_s === null ? null : timeOfDay(new Date(state.control.since_s * 1000));
  return (
    <>
      <button
        type="button"
        onClick={() => setOpen(true)}
        data-testid="control"
        className={cn(
          "flex min-h-11 items-center gap-2.5 rounded-full border px-4 py-1 text-left max-md:gap-1.5 max-md:px-3",
          mine && !isStale ? "border-alive-2 bg-alive-wash" : "border-line-strong bg-raised",
          isStale && "text-text-3 hatched",
        )}
      >
        <Icon aria-hidden="true" className={cn("size-4 shrink-0", isStale ? "text-text-3" : mine ? "text-alive" : holder !== null ? "text-attention" : "text-text-3")} />
        <span aria-hidden="true" className="max-w-16 truncate text-xs font-semibold md:max-w-28 lg:hidden" data-testid="control-short">
          {short}
        </span>
        <span className="max-lg:sr-only">
          <span className="block text-sm leading-tight font-semibold">{label}</span>
          {since !== null && <span className="block text-xs leading-tight text-text-3 numeric max-lg:hidden">{text("control_since", { time: since })}</span>}
        </span>
        {others.length > 0 && (
          <span className="flex items-center gap-1 border-l border-line pl-2.5 text-text-3 max-md:hidden lg:max-xl:hidden" title={others.map(({ name }) => name).join(", ")}>
            <Eye aria-hidden="true" className="size-4" />
            <span className="text-sm font-semibold numeric" data-testid="other-browsers">
              <span aria-hidden="true">{others.length}</span>
              <span className="sr-only">{text("also_here", { names: others.map(({ name }) => name).join(", ") })}</span>
            </span>
          </span>
        )}
      </button>
      <ControlDialog open={isOpen} onOpenChange={setOpen} />
    </>
  );
}

interface ControlFacts {
  /** Who has control was last known before the link was lost. */
  isStale: boolean;
  /** Another tab of this browser has control. */
  isWatching: boolean;
  mine: boolean;
  holder: string | null;
  isViewer: boolean;
}

/** Who has control, as an icon, in full, and in one word for a phone. */
function controlLabel(text: Text, { isStale, isWatching, mine, holder, isViewer }: ControlFacts) {
  const label = text(controlText({ isStale, mine, holder }), { holder: holder ?? "" });
  if (isWatching) return { icon: Copy, label: text("other_tab_has_control"), short: text("control_short_tab") };
  if (mine) return { icon: UserCheck, label, short: text("control_short_you") };
  if (holder !== null) return { icon: UserLock, label, short: holder };
  if (isViewer) return { icon: Eye, label: text("you_are_viewer"), short: text("control_short_viewer") };
  return { icon: UserRound, label, short: text("control_short_nobody") };
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
  const { lostMs, roundTripMs } = useLink();
  const known = lostMs === null && roundTripMs !== null;
  return <Reading value={known ? fixed(roundTripMs, 0) : UNKNOWN} unit={known ? "ms" : ""} label={text("link")} tone={known ? undefined! : "lost"} />;
}

const CHARGES: Record<Charge, { icon: typeof BatteryFull; tone: string }> = {
  unknown: { icon: BatteryFull, tone: "text-text-3" },
  good: { icon: BatteryFull, tone: "text-alive" },
  soon: { icon: BatteryMedium, tone: "text-attention" },
  low: { icon: BatteryWarning, tone: "text-stop-text" },
};

function BatteryReading() {
  const text = useText();
  const sample = useBattery();
  const share = chargeShare(sample?.message.percentage);
  const age = useAge(sample?.receivedMs);
  const isLost = useIsLinkLost();
  const isStale = age !== null && (isLost || age * 1000 > BATTERY_STALE_MS);
  // What is out of date says nothing of now, neither good nor bad.
  const charge = isStale ? "unknown" : chargeOf(share);
  const { icon: Icon, tone } = CHARGES[charge];
  return (
    <div className="flex items-center gap-2">
      <Icon aria-hidden="true" className={cn("size-6", tone)} />
      <div>
        <p className={cn("text-sm leading-tight font-semibold whitespace-nowrap", charge !== "good" && tone)}>
          <span className="sr-only">{text("battery")}: </span>
          <span className="numeric">{share === null ? UNKNOWN : fixed(share * 100, 0)}</span> %
        </p>
        <p className={cn("text-xs leading-tight whitespace-nowrap text-text-3 numeric", !isStale && "max-md:hidden")} data-testid="battery-age">
          {isStale ? text("ago", { age: formatDuration(age) }) : `${fixed(sample?.message.voltage, 2)} V`}
        </p>
      </div>
    </div>
  );
}

/** The robot's clock, from the mission's stamps or, without a mission, from the last ping: a wrong clock is seen here. */
function RobotTime() {
  const text = useText();
  const mission = useMission();
  const isLost = useIsLinkLost();
  const offsetS = useLink((link) => link.clockOffsetS);
  const now = useNow();
  const pinged = isLost || offsetS === null ? null : Math.floor(now / 1000 + offsetS);
  const seconds = mission?.header.stamp.sec ?? pinged;
  const value = seconds === null ? UNKNOWN : writeMoment(seconds);
  return <Reading value={value} unit="" label={text("robot_time")} {...(isLost ? { tone: "lost" as const } : {})} />;
}
