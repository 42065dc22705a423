import type { ReactNode } from "react";
import { TOPICS } from "@/generated/graph";
import { useBattery } from "@/hooks/use_situation";
import { useTopic } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { useLink } from "@/robot/link";
import { useSetting } from "@/state/settings";
import { cn } from "@/ui/cn";
import { fixed, signed, formatDuration } from "@/ui/numbers";
import { type Freshness, useFreshness } from "@/widgets/freshness";
import { Sparkline } from "@/widgets/sparkline";
import { SpringNumber } from "@/widgets/spring_number";
import type { TimeSeries } from "@/widgets/time_series";
import { type Charge, chargeOf, chargeShare } from "@/state/battery";
import { useLastMinute, useRoundTrips } from "./feeds";
import { orientation } from "./orientation";

/** Fast streams are drawn at this rate at most. */
export const FAST = { throttleMs: 50 };

interface TileProps {
  title: string;
  value: ReactNode;
  unit: string;
  /** Where the value comes from. */
  source: string;
  freshness?: Freshness;
  tone?: "attention";
  children?: ReactNode;
}

/** A large value that can be read from three meters away. */
function Tile({ title, value, unit, source, freshness, tone, children }: TileProps) {
  const text = useText();
  const isEmpty = freshness?.age === null;
  const isStale = freshness?.isStale === true;
  return (
    <section aria-label={title} className={cn("panel flex min-w-0 flex-col px-4 py-3", isStale && "hatched")}>
      <h2 className="text-sm font-semibold text-text-2">{title}</h2>
      <p
        className={cn(
          "flex items-baseline gap-1.5 text-2xl leading-tight font-bold whitespace-nowrap tabular-nums slashed-zero max-md:text-xl",
          (isStale || isEmpty) && "text-text-3",
          tone === "attention" && !isStale && "text-attention",
        )}
      >
        <span>{value}</span>
        <span className="text-base font-normal text-text-3">{unit}</span>
      </p>
      <p className={cn("line-clamp-2 text-xs leading-tight wrap-anywhere", isStale ? "text-attention" : "text-text-3")}>
        {isStale ? text("telemetry_silent", { age: formatDuration(freshness?.age) }) : isEmpty ? text("telemetry_nothing_yet", { source }) : source}
      </p>
      {children}
    </section>
  );
}

export function SpeedTile() {
  const text = useText();
  const row = { name: useSetting("odomTopic"), type: TOPICS.ODOM.type };
  const sample = useTopic(row, FAST);
  const series = useLastMinute(row, ({ twist }) => Math.hypot(twist.twist.linear.x, twist.twist.linear.y), FAST);
  const freshness = useFreshness(row.name, sample?.receivedMs);
  const linear = sample?.message.twist.twist.linear;
  return (
    <Tile title={text("telemetry_speed")} value={fixed(linear && Math.hypot(linear.x, linear.y), 2)} unit="m/s" source={row.name} freshness={freshness}>
      <Sparkline series={series} label={text("telemetry_last_minute", { title: text("telemetry_speed") })} minSpan={0.3} withZero isStale={freshness.isStale} className="mt-1 h-7" />
    </Tile>
  );
}

export function TurnTile() {
  const text = useText();
  const row = { name: useSetting("imuTopic"), type: TOPICS.IMU.type };
  const sample = useTopic(row, FAST);
  const series = useLastMinute(row, (message) => message.angular_velocity.z, FAST);
  const freshness = useFreshness(row.name, sample?.receivedMs);
  return (
    <Tile title={text("telemetry_turn")} value={fixed(sample?.message.angular_velocity.z, 2)} unit="rad/s" source={text("telemetry_raw", { source: row.name })} freshness={freshness}>
      <Sparkline series={series} label={text("telemetry_last_minute", { title: text("telemetry_turn") })} minSpan={0.6} withZero isStale={freshness.isStale} className="mt-1 h-7" />
    </Tile>
  );
}

export function NearestTile({ scan, series }: { scan: { nearestM: number | null; receivedMs: number } | null; series: TimeSeries }) {
  const text = useText();
  const topic = useSetting("scanTopic");
  const freshness = useFreshness(topic, scan?.receivedMs);
  const isClose = scan?.nearestM !== null && scan !== null && scan.nearestM < 0.3;
  return (
    <Tile
      title={text("nearest_obstacle")}
      value={fixed(scan?.nearestM, 2)}
      unit="m"
      source={isClose ? text("telemetry_close") : topic}
      freshness={freshness}
      {...(isClose ? { tone: "attention" as const } : {})}
    >
      <Sparkline series={series} label={text("telemetry_last_minute", { title: text("nearest_obstacle") })} minSpan={0.5} withZero isStale={freshness.isStale} className="mt-1 h-7" />
    </Tile>
  );
}

export function BatteryTile() {
  const text = useText();
  const topic = useSetting("batteryTopic");
  const sample = useBattery();
  const freshness = useFreshness(topic, sample?.receivedMs, 5);
  const share = chargeShare(sample?.message.percentage);
  const current = sample?.message.current;
  return (
    <Tile
      title={text("telemetry_battery_voltage")}
      value={<SpringNumber value={sample?.message.voltage} places={2} flashFrom={0.1} className="tabular-nums slashed-zero" />}
      unit="V"
      source={[share === null ? null : `${fixed(share * 100, 0)} %`, Number.isFinite(current) ? `${signed(current, 1)} A` : null].filter(Boolean).join(", ") || topic}
      freshness={freshness}
    >
      <ChargeBar share={share} isStale={freshness.isStale} />
    </Tile>
  );
}

const CHARGE_COLORS: Record<Charge, string> = { good: "bg-alive", soon: "bg-attention", low: "bg-stop-text", unknown: "bg-text-3" };

function ChargeBar({ share, isStale }: { share: number | null; isStale: boolean }) {
  return (
    <div aria-hidden="true" className="mt-1 flex h-7 items-center">
      <div className="h-1.5 grow overflow-hidden rounded-full bg-raised outline outline-line">
        <div className={cn("h-full rounded-full", isStale ? "bg-text-3" : CHARGE_COLORS[chargeOf(share)])} style={{ width: `${(share ?? 0) * 100}%` }} />
      </div>
    </div>
  );
}

export function HeadingTile() {
  const text = useText();
  const name = useSetting("odomTopic");
  const sample = useTopic({ name, type: TOPICS.ODOM.type }, FAST);
  const freshness = useFreshness(name, sample?.receivedMs);
  const pose = sample?.message.pose.pose;
  const yaw = pose === undefined ? null : orientation(pose.orientation)?.yawDeg;
  const source = pose === undefined ? name : text("telemetry_at", { x: fixed(pose.position.x, 2), y: fixed(pose.position.y, 2) });
  return (
    <Tile title={text("telemetry_heading")} value={fixed(yaw, 0)} unit="°" source={source} freshness={freshness}>
      <Needle degrees={yaw} isStale={freshness.isStale} />
    </Tile>
  );
}

/** The robot's heading: straight up is 0, to the left is positive, as in the map. */
function Needle({ degrees, isStale }: { degrees: number | null | undefined; isStale: boolean }) {
  if (degrees === null || degrees === undefined) return null;
  return (
    <svg viewBox="0 0 28 28" aria-hidden="true" className={cn("mt-1 size-7", isStale ? "text-text-3" : "text-sensed")}>
      <circle cx="14" cy="14" r="12.5" className="fill-none stroke-line-strong" strokeWidth="1.5" />
      <path d="M14 4 L18.5 21 L14 17.5 L9.5 21 Z" fill="currentColor" transform={`rotate(${-degrees} 14 14)`} />
    </svg>
  );
}

export function LinkTile() {
  const text = useText();
  const { state, roundTripMs } = useLink();
  const series = useRoundTrips();
  const isKnown = state === "open" && roundTripMs !== null;
  return (
    <Tile title={text("telemetry_link")} value={fixed(isKnown ? roundTripMs : null, 0)} unit="ms" source={text(state === "open" ? "telemetry_round_trip" : "telemetry_no_link")}>
      <Sparkline series={series} label={text("telemetry_last_minute", { title: text("telemetry_link") })} minSpan={20} withZero isStale={!isKnown} className="mt-1 h-7" />
    </Tile>
  );
}
