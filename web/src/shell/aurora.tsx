import { useEffect, useRef } from "react";
import { useConsole } from "@/api/console_store";
import { useEstop, useMission } from "@/hooks/use_situation";
import { useLink } from "@/robot/link";
import { isActive } from "@/state/sentence";
import { useSetting } from "@/state/settings";
import { cn } from "@/ui/cn";
import { type Animation, animate } from "./aurora/animation";
import { LOOKS, type Mood, moodOf } from "./aurora/mood";

const GRADIENTS: Record<Mood, string> = {
  calm: "bg-[radial-gradient(60%_80%_at_10%_40%,rgb(29_127_139_/_0.35),transparent),radial-gradient(50%_70%_at_80%_90%,rgb(143_176_47_/_0.25),transparent)]",
  mission: "bg-[radial-gradient(60%_80%_at_10%_40%,rgb(29_127_139_/_0.55),transparent),radial-gradient(50%_70%_at_80%_90%,rgb(143_176_47_/_0.45),transparent)]",
  stopped: "bg-[radial-gradient(70%_90%_at_20%_50%,rgb(150_20_20_/_0.5),transparent),radial-gradient(60%_80%_at_90%_80%,rgb(120_16_16_/_0.45),transparent)]",
  lost: "bg-[radial-gradient(60%_80%_at_10%_40%,rgb(120_130_124_/_0.25),transparent),radial-gradient(50%_70%_at_80%_90%,rgb(120_130_124_/_0.18),transparent)]",
};

/**
 * The living background, in the mood of the robot; a faint tint in the light theme. Behind everything, and behind a scrim that
 * keeps texts readable. Where it would take the page's frames, as without a graphics processor, its gradients stand still instead.
 */
export function Aurora() {
  const mood = useMood();
  const solid = useSetting("reduceTransparency");
  const isLight = useSetting("theme") === "light";
  return (
    <div aria-hidden="true" data-mood={mood} className="fixed inset-0 -z-10 overflow-hidden">
      <div className={cn("absolute inset-0", !solid && GRADIENTS[mood], isLight && "opacity-50")} />
      {!solid && !isLight && <Shader mood={mood} />}
      <div className="absolute inset-0 bg-void/35" />
    </div>
  );
}

function useMood(): Mood {
  const linkOpen = useLink((link) => link.state === "open");
  const wasOpen = useLink((link) => link.wasOpen);
  const serverStops = useConsole((state) => state.stop.length > 0);
  const estop = useEstop();
  const mission = useMission();
  return moodOf({ linkOpen, wasOpen, stopped: estop.engaged === true || serverStops, missionRuns: isActive(mission) });
}

function Shader({ mood }: { mood: Mood }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const animation = useRef<Animation>(null);
  const look = LOOKS[mood];
  const first = useRef(look);
  useEffect(() => {
    if (canvas.current === null) return;
    const started = animate(canvas.current, first.current);
    animation.current = started;
    return () => started.end();
  }, []);
  useEffect(() => animation.current?.show(look), [look]);
  return <canvas ref={canvas} className="absolute inset-0 size-full" />;
}
