import { useEffect, useRef } from "react";
import { useConsole } from "@/api/console_store";
import { useEstop, useMission } from "@/hooks/use_situation";
import { useLink } from "@/robot";
import { isActive } from "@/state/sentence";
import { useSetting } from "@/state/settings";
import { cn } from "@/ui/cn";
import { LOOKS, type Mood, approach, isSettled, moodOf } from "./aurora/mood";
import { createShader } from "./aurora/shader";

/** Drawn at a third of the page's size and scaled up by the compositor: it has no edges that would be seen. */
const SHARE = 1 / 3;
const MAX_PIXELS = 320_000;
const FRAME_MS = 1000 / 30;
/** Between moods the drift is so slow that fewer frames look the same, at a third of the work. */
const CALM_FRAME_MS = 1000 / 10;
/** How fast the noise drifts at full pace, per second. */
const DRIFT = 0.024;
const START = 12.4;

const GRADIENTS: Record<Mood, string> = {
  calm: "bg-[radial-gradient(60%_80%_at_10%_40%,rgb(29_127_139_/_0.35),transparent),radial-gradient(50%_70%_at_80%_90%,rgb(143_176_47_/_0.25),transparent)]",
  mission: "bg-[radial-gradient(60%_80%_at_10%_40%,rgb(29_127_139_/_0.55),transparent),radial-gradient(50%_70%_at_80%_90%,rgb(143_176_47_/_0.45),transparent)]",
  stopped: "bg-[radial-gradient(70%_90%_at_20%_50%,rgb(150_20_20_/_0.5),transparent),radial-gradient(60%_80%_at_90%_80%,rgb(120_16_16_/_0.45),transparent)]",
  lost: "bg-[radial-gradient(60%_80%_at_10%_40%,rgb(120_130_124_/_0.25),transparent),radial-gradient(50%_70%_at_80%_90%,rgb(120_130_124_/_0.18),transparent)]",
};

/** The living background, in the mood of the robot. Behind everything, and behind a scrim that keeps texts readable. */
export function Aurora() {
  const mood = useMood();
  const solid = useSetting("reduceTransparency");
  return (
    <div aria-hidden="true" data-mood={mood} className="fixed inset-0 -z-10 overflow-hidden">
      <div className={cn("absolute inset-0", !solid && GRADIENTS[mood])} />
      {!solid && <Shader mood={mood} />}
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
  const goal = useRef(LOOKS[mood]);
  useEffect(() => {
    goal.current = LOOKS[mood];
  }, [mood]);
  useEffect(() => (canvas.current === null ? undefined : animate(canvas.current, () => goal.current)), []);
  return <canvas ref={canvas} className="absolute inset-0 size-full" />;
}

/** Draw until the returned function is called. Without WebGL or with reduced motion, the gradient below is seen instead. */
function animate(canvas: HTMLCanvasElement, goal: () => (typeof LOOKS)[Mood]): () => void {
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  let shader = still.matches ? null : createShader(canvas);
  let look = goal();
  let time = START;
  let lastMs = 0;
  let frame = 0;
  canvas.hidden = shader === null;

  const fit = () => {
    const { clientWidth, clientHeight } = document.documentElement;
    const share = Math.min(SHARE, Math.sqrt(MAX_PIXELS / Math.max(1, clientWidth * clientHeight)));
    shader?.resize(Math.max(1, Math.round(clientWidth * share)), Math.max(1, Math.round(clientHeight * share)));
    lastMs = 0;
  };
  const draw = (nowMs: number) => {
    frame = requestAnimationFrame(draw);
    if (nowMs - lastMs < (isSettled(look, goal()) ? CALM_FRAME_MS : FRAME_MS) - 2) return;
    const stepS = lastMs === 0 ? 0 : Math.min(0.2, (nowMs - lastMs) / 1000);
    lastMs = nowMs;
    look = approach(look, goal(), stepS);
    time += stepS * DRIFT * look.pace;
    shader?.draw(look, time);
  };
  const begin = () => {
    cancelAnimationFrame(frame);
    if (shader !== null && !document.hidden) frame = requestAnimationFrame(draw);
  };
  const onMotion = () => {
    shader = still.matches ? null : createShader(canvas);
    canvas.hidden = shader === null;
    fit();
    begin();
  };
  // A browser may take the context back, for example when its graphics process ends.
  const onLost = (event: Event) => {
    event.preventDefault();
    shader = null;
    canvas.hidden = true;
    begin();
  };

  fit();
  begin();
  window.addEventListener("resize", fit);
  document.addEventListener("visibilitychange", begin);
  still.addEventListener("change", onMotion);
  canvas.addEventListener("webglcontextlost", onLost);
  canvas.addEventListener("webglcontextrestored", onMotion);
  return () => {
    cancelAnimationFrame(frame);
    window.removeEventListener("resize", fit);
    document.removeEventListener("visibilitychange", begin);
    still.removeEventListener("change", onMotion);
    canvas.removeEventListener("webglcontextlost", onLost);
    canvas.removeEventListener("webglcontextrestored", onMotion);
  };
}
