import { type ReactNode, Suspense, useCallback, useEffect } from "react";
import { create } from "zustand";
import { useText } from "@/i18n/text";
import { MapCanvas } from "@/map/map_canvas";
import { useMapUi } from "@/map/map_ui";
import { hasWebGl } from "@/widgets/webgl";
import { type View, scaleBar } from "@/map/view";
import { RewindButton } from "@/rewind/rewind_bar";
import { useIsRewound } from "@/state/rewind";
import { useSetting } from "@/state/settings";
import { Boundary, type FallbackProps } from "@/ui/boundary";
import { cn } from "@/ui/cn";
import { deferred } from "@/ui/deferred";
import { GoalBar } from "./goal_bar";
import { HeatLegend } from "./heat_legend";
import { Legend } from "./legend";
import { MapNotices, NoMap } from "./map_notices";
import { LayerChoice, MapTools, ModeChoice } from "./toolbar";

// Loaded when it is shown only: it is larger than all the rest.
const MapScene = deferred(() => import("@/map/three/map_scene"), { preloaded: false });

/** CSS pixels per meter of the shown view. */
const useMapScale = create<{ scale: number }>(() => ({ scale: 50 }));
const useSceneFailure = create<{ reason: string }>(() => ({ reason: "" }));

export function MapView({ className }: { className?: string }) {
  const text = useText();
  const mode = useMapUi((state) => state.mode);
  const failure = useSceneFailure((state) => state.reason);
  // Whoever chooses 3D again wants another try.
  useEffect(() => {
    if (mode === "2d") useSceneFailure.setState({ reason: "" });
  }, [mode]);
  const onView = useCallback(({ scale }: View) => {
    if (useMapScale.getState().scale !== scale) useMapScale.setState({ scale });
  }, []);
  // While a pose is drawn, what lies over the map makes room for it.
  const isDrawing = useMapUi((state) => state.tool !== "move" || state.draft !== null);
  const isRewound = useIsRewound();
  const isSceneShown = mode === "3d" && hasWebGl() && failure === "";
  return (
    <section aria-label={text("map_title")} className={cn("dark-island relative overflow-hidden rounded-lg border border-line bg-void/70", className)}>
      <p id="map-keys" className="sr-only">
        {text("map_keys")}
      </p>
      {isSceneShown ? (
        <Boundary fallback={SceneFailed}>
          <Suspense fallback={<Centered>{text("map_loading_3d")}</Centered>}>
            <MapScene onView={onView} />
          </Suspense>
        </Boundary>
      ) : (
        <MapCanvas onView={onView} />
      )}
      <div className="pointer-events-none absolute inset-x-3 top-3 flex items-start gap-2 select-none">
        <div className="flex min-w-0 grow flex-wrap gap-2">
          <ModeChoice />
          {!isRewound && <LayerChoice />}
          <RewindButton className="pointer-events-auto" />
        </div>
        <MapTools className="max-md:hidden" />
      </div>
      <NoMap />
      <div className="pointer-events-none absolute inset-x-3 bottom-3 flex items-end justify-between gap-4 select-none">
        <div className={cn("flex min-w-0 flex-col gap-3", isDrawing && "max-md:hidden")}>
          {!isRewound && <HeatLegend />}
          <div className="flex items-end gap-6">
            <ScaleBar />
            {!isDrawing && <Legend />}
          </div>
        </div>
        <MapTools className={cn("flex-row md:hidden", isDrawing && "hidden")} />
      </div>
      <div
        className={cn(
          "pointer-events-none absolute inset-x-3 flex flex-col items-center gap-2 select-none",
          isDrawing ? "bottom-3 items-end md:left-64 md:items-center" : "bottom-16",
        )}
      >
        <MapNotices sceneFailure={mode === "3d" ? failure : ""} />
        {!isRewound && <GoalBar />}
      </div>
    </section>
  );
}

function Centered({ children }: { children: ReactNode }) {
  return <p className="grid size-full place-items-center text-text-2">{children}</p>;
}

function ScaleBar() {
  const text = useText();
  const scale = useMapScale((state) => state.scale);
  const turned = useSetting("polarityInvertHmi");
  const { meters, pixels } = scaleBar(scale, 100);
  const length = meters < 1 ? `${Math.round(meters * 100)} cm` : `${meters} m`;
  return (
    <div role="img" aria-label={text("map_scale", { length })} className="shrink-0 text-sm text-text-2 max-md:text-xs">
      {turned && <p className="mb-1 text-attention">{text("map_turned")}</p>}
      <span className="numeric">{length}</span>
      <div className="h-1.5 border border-t-0 border-text-2" style={{ width: pixels }} />
    </div>
  );
}

/** A view in 3D may fail where the browser takes its WebGL away; the map goes on in 2D. */
function SceneFailed({ reason }: FallbackProps) {
  useEffect(() => useSceneFailure.setState({ reason }), [reason]);
  return null;
}
