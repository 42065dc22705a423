import { useRef } from "react";
import { useBattery } from "@/hooks/use_situation";
import { type TextKey, useText } from "@/i18n/text";
import { useSpring } from "@/motion/spring";
import { useSetting } from "@/state/settings";
import { cn } from "@/ui/cn";
import { fixed, signed } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { useFreshness } from "@/widgets/freshness";
import { Sparkline } from "@/widgets/sparkline";
import { SpringNumber } from "@/widgets/spring_number";
import { type Charge, chargeOf, chargeShare } from "@/state/battery";
import { useVoltages } from "./feeds";

const WORDS: Record<Charge, { word: TextKey; ring: string; tone: string }> = {
  good: { word: "telemetry_charge_good", ring: "stroke-alive", tone: "text-alive" },
  soon: { word: "telemetry_charge_soon", ring: "stroke-attention", tone: "text-attention" },
  low: { word: "telemetry_charge_low", ring: "stroke-stop-text", tone: "text-stop-text" },
  unknown: { word: "telemetry_charge_unknown", ring: "stroke-text-3", tone: "text-text-3" },
};

const STALE_S = 5;

/** The charge as a ring with its number and word, and the voltage of the last minutes. */
export function BatteryPanel({ className }: { className?: string }) {
  const text = useText();
  const topic = useSetting("batteryTopic");
  const sample = useBattery();
  const voltages = useVoltages(topic);
  const { panel, isStale } = useFreshness(topic, sample?.receivedMs, STALE_S);
  const message = sample?.message;
  const share = chargeShare(message?.percentage);
  const charge = chargeOf(share);
  return (
    <Panel title={text("telemetry_battery")} aside={text("telemetry_last_minutes", { count: voltages.windowS / 60 })} {...panel} {...(className === undefined ? {} : { className })}>
      <div className="flex h-full min-h-32 items-stretch gap-5">
        <div className="grid place-items-center">
          <Ring share={share} ring={isStale ? "stroke-text-3" : WORDS[charge].ring}>
            <p className="text-xl leading-none font-bold tabular-nums slashed-zero">
              {share === null ? "–" : <SpringNumber value={share * 100} places={0} flashFrom={1} className="" />}
              <span className="text-sm font-normal text-text-3"> %</span>
            </p>
            <p className={cn("mt-1 text-xs leading-tight font-semibold", isStale ? "text-text-3" : WORDS[charge].tone)}>{text(WORDS[charge].word)}</p>
          </Ring>
        </div>
        <div className="flex min-w-0 grow flex-col">
          <p className={cn("text-xl leading-tight font-bold tabular-nums slashed-zero", isStale && "text-text-3")}>
            <SpringNumber value={message?.voltage} places={2} flashFrom={0.1} className="" />
            <span className="text-sm font-normal text-text-3"> V</span>
            <span className="ml-4 text-base font-semibold text-text-2">
              {signed(message?.current, 2)}
              <span className="text-xs font-normal text-text-3"> A</span>
            </span>
          </p>
          <Sparkline series={voltages} label={text("telemetry_voltage")} minSpan={0.1} isStale={isStale} className="mt-2 min-h-12 grow" />
          <p className="flex justify-between text-xs text-text-3 numeric">
            <span>{text("telemetry_minutes_ago", { count: voltages.windowS / 60 })}</span>
            <span>{text("telemetry_now")}</span>
          </p>
        </div>
      </div>
      <p className="sr-only" role="status">
        {text("telemetry_battery")}: {fixed(share === null ? null : share * 100, 0)} %, {text(WORDS[charge].word)}
      </p>
    </Panel>
  );
}

const RADIUS = 54;
const LENGTH = 2 * Math.PI * RADIUS;

function Ring({ share, ring, children }: { share: number | null; ring: string; children: React.ReactNode }) {
  const arc = useRef<SVGCircleElement>(null);
  useSpring(share, (shown) => arc.current?.setAttribute("stroke-dashoffset", String(Number.isFinite(shown) ? LENGTH * (1 - shown) : LENGTH)));
  return (
    <div className="relative grid size-32 place-items-center text-center">
      <svg viewBox="0 0 128 128" aria-hidden="true" className="absolute inset-0 -rotate-90">
        <circle cx="64" cy="64" r={RADIUS} className="fill-none stroke-raised" strokeWidth="11" />
        <circle ref={arc} cx="64" cy="64" r={RADIUS} className={cn("fill-none", ring)} strokeWidth="11" strokeLinecap="round" strokeDasharray={LENGTH} strokeDashoffset={LENGTH} />
      </svg>
      <div className="relative">{children}</div>
    </div>
  );
}
