import { type PointerEvent, useCallback, useEffect, useRef, useState } from "react";
import { TOPICS } from "@/generated/graph";
import { useAge } from "@/hooks/use_now";
import { useSamples } from "@/hooks/use_topic";
import { type Text, useText } from "@/i18n/text";
import { useSetting } from "@/state/settings";
import { fixed, formatDuration } from "@/ui/numbers";
import { Segments } from "@/ui/segments";
import { useArmModel } from "./arm_model";
import { type JointLabel, type Picture, drawArm } from "./arm_drawing";
import { type Command, type Commands, jointPhase } from "./commands";
import { PHASES } from "./joint_row";
import { ARM, type Angles, type Joint, measuredAngles } from "./joints";
import { type Camera, VIEWS } from "./scene";
import { JOINTS_STALE_MS, JOINTS_THROTTLE, type Measured } from "./use_arm";

type ViewName = keyof typeof VIEWS;
const VIEW_NAMES = Object.keys(VIEWS) as ViewName[];
/** A smaller difference between the commanded and the measured pose is invisible in the drawing. */
const GHOST_DEG = 1;
const DEGREES_PER_PX = 0.4;

/** The arm in the middle of the tab: bodies as measured, the commanded pose as a dashed ghost. */
export function ArmView({ measured }: { measured: Measured }) {
  const text = useText();
  const arm = useArmModel();
  const canvas = useRef<HTMLCanvasElement>(null);
  const angles = useRef<Angles>({});
  const receivedMs = useRef<number | null>(null);
  const [view, setView] = useState<ViewName>("free");
  const camera = useRef<Camera>({ ...VIEWS.free });
  const held = useRef<{ x: number; y: number; from: Camera } | null>(null);
  const frame = useRef(0);
  const drawn = useRef("");
  const topic = useSetting("jointStatesTopic");
  const age = useAge(measured.receivedMs);
  const isStale = age !== null && age * 1000 > JOINTS_STALE_MS;

  const paint = useCallback(() => {
    frame.current = 0;
    if (canvas.current === null) return;
    const { commands, thumbs } = arm.store.getState();
    const nowMs = performance.now();
    const stale = receivedMs.current === null || nowMs - receivedMs.current > JOINTS_STALE_MS;
    const picture: Picture = {
      camera: camera.current,
      measured: angles.current,
      commanded: ghost(angles.current, commands, thumbs),
      isStale: stale,
      labels: ARM.map((joint) => labelOf(joint, commands[joint.name], angles.current[joint.name], stale, nowMs, text)),
    };
    // Joint states also come while the arm rests: then there is nothing to draw.
    const { clientWidth, clientHeight } = canvas.current;
    const shown = JSON.stringify([picture, clientWidth, clientHeight], (_, value: unknown) => (typeof value === "number" ? Math.round(value * 10) : value));
    if (shown === drawn.current) return;
    drawn.current = shown;
    drawArm(canvas.current, picture);
  }, [arm, text]);

  const draw = useCallback(() => {
    if (frame.current === 0) frame.current = requestAnimationFrame(paint);
  }, [paint]);

  useSamples(
    { name: topic, type: TOPICS.JOINT_STATES.type },
    (sample) => {
      angles.current = measuredAngles(sample.message);
      receivedMs.current = sample.receivedMs;
      draw();
    },
    JOINTS_THROTTLE,
  );
  useEffect(() => arm.store.subscribe(draw), [arm, draw]);
  useEffect(draw, [draw, isStale]);
  useEffect(() => {
    const element = canvas.current;
    if (element === null) return;
    const observer = new ResizeObserver(draw);
    observer.observe(element);
    return () => {
      observer.disconnect();
      cancelAnimationFrame(frame.current);
      frame.current = 0;
    };
  }, [draw]);

  function show(next: ViewName): void {
    setView(next);
    camera.current = { ...VIEWS[next] };
    draw();
  }

  function turn(event: PointerEvent): void {
    if (held.current === null) return;
    const { x, y, from } = held.current;
    setView("free");
    camera.current = {
      yawDeg: from.yawDeg + (event.clientX - x) * DEGREES_PER_PX,
      pitchDeg: Math.min(90, Math.max(0, from.pitchDeg + (event.clientY - y) * DEGREES_PER_PX)),
    };
    draw();
  }

  return (
    <section aria-label={text("arm_view")} className="panel relative min-h-72 overflow-hidden">
      <canvas
        ref={canvas}
        role="img"
        aria-label={text("arm_view_alt")}
        className="absolute inset-0 size-full cursor-grab touch-pan-y active:cursor-grabbing"
        onPointerDown={(event) => {
          event.currentTarget.setPointerCapture(event.pointerId);
          held.current = { x: event.clientX, y: event.clientY, from: camera.current };
        }}
        onPointerMove={turn}
        onPointerUp={() => (held.current = null)}
        onPointerCancel={() => (held.current = null)}
      />
      <Segments
        label={text("arm_view")}
        value={view}
        options={VIEW_NAMES.map((value) => ({ value, label: text(`arm_view_${value}`) }))}
        onChange={show}
        className="absolute top-3 left-3"
      />
      <p className="pointer-events-none absolute right-4 bottom-3 flex flex-wrap justify-end gap-x-4 text-xs text-text-2">
        <span className="flex items-center gap-2">
          <span aria-hidden="true" className="h-1 w-6 rounded-full bg-text" />
          {text("arm_measured")}
        </span>
        <span className="flex items-center gap-2">
          <span aria-hidden="true" className="w-6 border-t-2 border-dashed border-alive" />
          {text("arm_commanded")}
        </span>
      </p>
      {age === null && <p className="absolute inset-x-4 top-1/3 text-center text-text-2">{text("no_sample_yet", { topic })}</p>}
      {isStale && (
        <p className="absolute top-3 right-3 rounded-sm bg-panel px-3 py-1.5 text-sm text-attention hatched">{text("stale_since", { topic, age: formatDuration(age) })}</p>
      )}
    </section>
  );
}

function labelOf(joint: Joint, command: Command | undefined, degrees: number | undefined, isStale: boolean, nowMs: number, text: Text): JointLabel {
  const phase = jointPhase(joint, command, isStale ? undefined : degrees, nowMs);
  const isAsked = command !== undefined && (phase === "moving" || phase === "stalled");
  return {
    joint: joint.name,
    title: `${text(joint.label)} ${fixed(degrees, 1)}°`,
    note: isAsked ? text("arm_asked", { angle: fixed(command.targetDeg, 1) }) : text(PHASES[phase].label),
    tone: phase === "stalled" ? "attention" : phase === "moving" ? "moving" : phase === "unknown" ? "lost" : "calm",
  };
}

/** The commanded pose, including sliders that are being dragged; null if it equals the measured pose. */
function ghost(measured: Angles, commands: Commands, thumbs: Angles): Angles | null {
  const pose: Angles = { ...measured };
  let differs = false;
  for (const { name } of ARM) {
    const target = thumbs[name] ?? commands[name]?.targetDeg;
    if (target === undefined) continue;
    pose[name] = target;
    differs ||= Math.abs(target - (measured[name] ?? target)) > GHOST_DEG;
  }
  return differs ? pose : null;
}
