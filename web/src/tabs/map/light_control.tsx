import { Lightbulb } from "lucide-react";
import { useState } from "react";
import { SERVICES, TOPICS } from "@/generated/graph";
import { LED_COLORS, LED_RULES_BEFORE_COLOR } from "@/generated/robot";
import { useAge } from "@/hooks/use_now";
import { useTopic } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { formatDuration } from "@/ui/numbers";
import { RobotWords } from "@/ui/robot_words";

type ColorName = keyof typeof LED_COLORS;
const COLORS = Object.keys(LED_COLORS) as ColorName[];

/** Control of the light strip: a fixed color, or automatic, which shows the robot's state. */
export function LightControl() {
  const text = useText();
  const [confirmed, setConfirmed] = useState<{ what: ColorName | "auto"; atMs: number } | null>(null);
  const [asked, setAsked] = useState<ColorName | "auto" | null>(null);
  const age = useAge(confirmed?.atMs);
  const rule = useTopic(TOPICS.LEDS_STATUS)?.message.data;
  const hiddenBy = confirmed === null || confirmed.what === "auto" ? undefined : LED_RULES_BEFORE_COLOR.find((each) => each === rule);

  async function set(what: ColorName | "auto"): Promise<void> {
    setAsked(what);
    try {
      const atMs = await send(what);
      if (atMs === null) throw new Error(text("map_lights_refused"));
      setConfirmed({ what, atMs });
    } catch (error) {
      showProblem(error);
    } finally {
      setAsked(null);
    }
  }

  return (
    <div className="px-4 py-4">
      <p className="pb-1 text-sm text-text-2">{text("map_lights_hint")}</p>
      <p role="status" className="pb-3 text-xs text-text-3">
        {confirmed === null
          ? text("map_lights_unknown")
          : confirmed.what === "auto"
            ? text("map_lights_set_auto", { age: formatDuration(age) })
            : text("map_lights_set", { color: text(`map_color_${confirmed.what}`), age: formatDuration(age) })}
        {hiddenBy !== undefined && (
          <span className="block text-attention">
            {text("map_lights_hidden")} <RobotWords words={hiddenBy} />
          </span>
        )}
      </p>
      <div role="group" aria-label={text("map_lights")} className="grid grid-cols-4 gap-2">
        {COLORS.map((name) => (
          <button
            key={name}
            type="button"
            disabled={asked !== null}
            aria-pressed={confirmed?.what === name}
            onClick={() => void set(name)}
            className={cn(
              "flex min-h-16 flex-col items-center justify-center gap-1.5 rounded-md border bg-raised text-xs hover:bg-hover",
              confirmed?.what === name ? "border-text" : "border-line",
              asked === name && "hatched",
            )}
          >
            <span
              aria-hidden="true"
              className="size-6 rounded-full border border-line-strong"
              style={{ backgroundColor: `rgb(${LED_COLORS[name].join(" ")})` }}
            />
            {text(`map_color_${name}`)}
          </button>
        ))}
      </div>
      <Button className="mt-3 w-full" aria-pressed={confirmed?.what === "auto"} disabled={asked !== null} onClick={() => void set("auto")}>
        <Lightbulb />
        {text("map_lights_auto")}
      </Button>
    </div>
  );
}

/** When the strip confirmed the color or the automatic mode; null if it refused. */
async function send(what: ColorName | "auto"): Promise<number | null> {
  let isDone: boolean;
  if (what === "auto") {
    isDone = (await call(SERVICES.LEDS_AUTO, {})).success;
  } else {
    const [r, g, b] = LED_COLORS[what];
    isDone = (await call(SERVICES.LEDS_SET, { color: { r, g, b } })).status;
  }
  return isDone ? performance.now() : null;
}
