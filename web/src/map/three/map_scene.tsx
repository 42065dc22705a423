/** The greenhouse in three dimensions, from the same data as the map from above. Loaded when it is first shown. */
import { Canvas, useFrame, useThree } from "@react-three/fiber";
import { useEffect, useMemo, useRef, useState } from "react";
import { useNow } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { inks, robotColor } from "@/map/draw/ink";
import { Gestures, setsHeading } from "@/map/gestures";
import { hitLabel } from "@/map/labels";
import type { Rectangle } from "@/map/labels";
import { POSE_STALE_MS, liveMap } from "@/map/live_map";
import { fitMargins, pixelOf } from "@/map/map_canvas";
import { MAP_SURFACE, handleMapKey } from "@/map/map_keys";
import { drawWithTool, toggleTag, useMapUi } from "@/map/map_ui";
import { useIsPhone, usePresentation } from "@/map/use_presentation";
import type { View } from "@/map/view";
import { drawsInSoftware } from "@/widgets/webgl";
import { cn } from "@/ui/cn";
import { formatDuration } from "@/ui/numbers";
import type { CameraRig } from "./camera_rig";
import { measureFrame } from "./frames";
import { Greenhouse } from "./greenhouse";
import { Labels } from "./labels";
import { Plan, Scan, TrailLine } from "./lines";
import { Plants } from "./plants";
import { Rig } from "./rig";
import { Robot } from "./robot";

const NO_LABELS: ReadonlyMap<string, Rectangle> = new Map();
/** While the operator moves the camera and frames take long, the scene has this share of its pixels along each side. */
const MOVING_RESOLUTION = { min: 0.6, debounce: 300 };

export default function MapScene({ onView }: { onView: (view: View) => void }) {
  const text = useText();
  const surface = useRef<HTMLDivElement>(null);
  const overlay = useRef<HTMLCanvasElement>(null);
  const rig = useRef<CameraRig | null>(null);
  const places = useRef(NO_LABELS);
  const presentation = usePresentation();
  const isPhone = useIsPhone();
  const tool = useMapUi((state) => state.tool);
  const [lost, setLost] = useState(false);
  const [resolution, setResolution] = useState(1);
  const hasField = presentation.layer !== null;
  const margins = useMemo(() => fitMargins(isPhone, hasField), [isPhone, hasField]);
  const gestures = useRef<Gestures>(null);
  gestures.current ??= createGestures(rig, places);
  if (lost) throw new Error("WebGL was taken away");

  const ink = inks();
  const { isStopped, isPoseStale } = presentation;
  return (
    <div
      ref={surface}
      role="application"
      {...MAP_SURFACE}
      aria-label={text("map_canvas_label_3d")}
      data-testid="map-scene"
      className={cn("relative size-full touch-none rounded-lg focus-visible:-outline-offset-2", tool === "move" ? "cursor-grab active:cursor-grabbing" : "cursor-crosshair")}
      onPointerDown={(event) => gestures.current?.down(event.pointerId, pixelOf(event), event.button === 0)}
      onPointerMove={(event) => gestures.current?.move(event.pointerId, pixelOf(event))}
      onPointerUp={(event) => gestures.current?.up(event.pointerId, pixelOf(event))}
      onPointerCancel={() => gestures.current?.cancel()}
      onContextMenu={(event) => event.preventDefault()}
      onKeyDown={(event) => handleMapKey(event, rig.current)}
    >
      <Canvas
        orthographic
        frameloop="demand"
        dpr={drawsInSoftware() ? resolution : [1, 2]}
        performance={MOVING_RESOLUTION}
        gl={{ antialias: !drawsInSoftware() }}
        flat
        camera={{ up: [0, 0, 1], position: [0, -40, 40], near: 0.1, far: 200, zoom: 50 }}
        className="pointer-events-none! absolute! inset-0"
        onCreated={({ gl }) => gl.domElement.addEventListener("webglcontextlost", () => setLost(true))}
      >
        <hemisphereLight args={["#f2fff6", "#6b8877", 3.2]} />
        <directionalLight position={[-3, -5, 8]} intensity={2.4} />
        <Rig surfaceRef={surface} rigRef={rig} margins={margins} turned={presentation.turned} onView={onView} />
        <Greenhouse />
        <Plants />
        <TrailLine color={ink.aliveDim} />
        <Plan isStopped={isStopped} color={ink.alive} />
        <Scan color={ink.sensed} isStale={isPoseStale} />
        <Robot color={robotColor(presentation)} isStopped={isStopped} isStale={isPoseStale} />
        <Cost onResolution={setResolution} />
        <Labels overlayRef={overlay} placesRef={places} presentation={presentation} />
      </Canvas>
      <canvas ref={overlay} aria-hidden="true" className="pointer-events-none absolute inset-0 size-full" />
      <StaleBadge />
    </div>
  );
}

/** Measures every frame, and tells how many pixels the next ones should have. */
function Cost({ onResolution }: { onResolution: (share: number) => void }) {
  const share = useThree((state) => state.performance.current);
  useFrame(measureFrame);
  useEffect(() => onResolution(share), [share, onResolution]);
  return null;
}

function createGestures(rig: { current: CameraRig | null }, places: { current: ReadonlyMap<string, Rectangle> }): Gestures {
  return new Gestures({
    draws: () => useMapUi.getState().tool !== "move",
    // The controls of the camera move and zoom by themselves.
    pan: () => {},
    zoom: () => {},
    tap: (at) => {
      const tag = hitLabel(places.current, at);
      if (tag !== null) toggleTag(tag);
    },
    draw: (start, end) => {
      const [from, to] = [rig.current?.toWorld(start), rig.current?.toWorld(end)];
      if (from && to) drawWithTool(from, to, setsHeading(start, end));
    },
    cancelDraw: () => useMapUi.setState({ draft: null }),
  });
}

/** What the model of the robot lacks: it stands still then, and must not look alive. */
function StaleBadge() {
  const text = useText();
  const now = useNow();
  const [shownMs] = useState(now);
  const age = (atMs: number | null) => (atMs === null ? null : now - atMs);
  const isSettled = now - shownMs > POSE_STALE_MS;
  const reasons: string[] = [];
  for (const [ageMs, never, stale] of [
    [age(liveMap.poseReceivedMs), "map_never_place", "map_stale_place"],
    [age(liveMap.jointsReceivedMs), "map_never_joints", "map_stale_joints"],
  ] as const) {
    if (ageMs === null && isSettled) reasons.push(text(never));
    if (ageMs !== null && ageMs > POSE_STALE_MS) reasons.push(text(stale, { age: formatDuration(ageMs / 1000) }));
  }
  if (reasons.length === 0) return null;
  return (
    <p role="status" className="pointer-events-none absolute top-18 left-3 rounded-sm border border-attention bg-panel px-2 py-1 text-xs text-attention">
      <strong className="uppercase">{text("stale")}</strong> · {reasons.join(" · ")}
    </p>
  );
}
