import { type PointerEvent, useEffect, useRef } from "react";
import { useText } from "@/i18n/text";
import { cn } from "@/ui/cn";
import { Gestures, setsHeading } from "./gestures";
import { liveMap } from "./live_map";
import { MAP_SURFACE, handleMapKey } from "./map_keys";
import { type Draft, drawWithTool, toggleTag, useMapUi } from "./map_ui";
import { MapRenderer } from "./renderer";
import { useIsPhone, usePresentation } from "./use_presentation";
import type { Margins, Point, View } from "./view";

interface MapCanvasProps {
  /** Called with every change of the view, for the scale bar. */
  onView: (view: View) => void;
}

/** The map from above: it is moved, zoomed and drawn on by pointer and keyboard. */
export function MapCanvas({ onView }: MapCanvasProps) {
  const text = useText();
  const surface = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const renderer = useRef<MapRenderer | null>(null);
  const presentation = usePresentation();
  const isPhone = useIsPhone();

  useEffect(() => {
    if (canvas.current === null) return;
    const created = new MapRenderer(canvas.current, liveMap, onView);
    renderer.current = created;
    useMapUi.setState({
      controls: {
        zoom: (factor) => created.zoom(factor),
        fit: () => {
          useMapUi.setState({ isFollowing: false });
          created.fit();
        },
        center: () => created.center(),
      },
    });
    return () => {
      created.close();
      renderer.current = null;
      useMapUi.setState({ controls: null });
    };
  }, [onView]);

  useEffect(() => {
    if (renderer.current === null) return;
    renderer.current.margins = fitMargins(isPhone, presentation.layer !== null);
    renderer.current.present(presentation);
  }, [presentation, isPhone]);

  const gestures = useGestures(renderer);

  useEffect(() => {
    const element = surface.current;
    if (element === null) return;
    const onWheel = (event: WheelEvent) => {
      event.preventDefault();
      gestures.current.wheel({ x: event.offsetX, y: event.offsetY }, event.deltaY * (event.deltaMode === 1 ? 16 : 1));
    };
    // Not passive: the wheel zooms the map and does not scroll the page.
    element.addEventListener("wheel", onWheel, { passive: false });
    return () => element.removeEventListener("wheel", onWheel);
  }, [gestures]);

  const tool = useMapUi((state) => state.tool);
  return (
    <div
      ref={surface}
      role="application"
      {...MAP_SURFACE}
      aria-label={text("map_canvas_label")}
      data-testid="map-canvas"
      className={cn("size-full touch-none rounded-lg focus-visible:-outline-offset-2", tool === "move" ? "cursor-grab active:cursor-grabbing" : "cursor-crosshair")}
      onPointerDown={(event) => {
        event.currentTarget.setPointerCapture(event.pointerId);
        gestures.current.down(event.pointerId, pixelOf(event), event.button === 0);
      }}
      onPointerMove={(event) => gestures.current.move(event.pointerId, pixelOf(event))}
      onPointerUp={(event) => gestures.current.up(event.pointerId, pixelOf(event))}
      onPointerCancel={() => gestures.current.cancel()}
      onContextMenu={(event) => event.preventDefault()}
      onKeyDown={(event) => handleMapKey(event, renderer.current)}
    >
      <canvas ref={canvas} aria-hidden="true" className="pointer-events-none size-full" />
    </div>
  );
}

/** What lies over the map at its edges: the toolbar above, the scale and the legends below, a field's legend and the tools beside. */
export function fitMargins(isPhone: boolean, hasField: boolean): Margins {
  return isPhone ? { top: 72, right: 14, bottom: 72, left: 14 } : { top: 72, right: 68, bottom: 48, left: hasField ? 256 : 28 };
}

export function pixelOf(event: PointerEvent<HTMLElement>): Point {
  const { left, top } = event.currentTarget.getBoundingClientRect();
  return { x: event.clientX - left, y: event.clientY - top };
}

function useGestures(renderer: { current: MapRenderer | null }): { current: Gestures } {
  const gestures = useRef<Gestures>(null);
  gestures.current ??= createGestures(renderer);
  return gestures as { current: Gestures };
}

function createGestures(renderer: { current: MapRenderer | null }): Gestures {
  // The pose before the one that is being drawn, which comes back where drawing is canceled.
  let before: { draft: Draft | null } | null = null;
  return new Gestures({
    draws: () => useMapUi.getState().tool !== "move",
    pan: (pixels) => {
      useMapUi.setState({ isFollowing: false });
      renderer.current?.pan(pixels);
    },
    zoom: (at, factor) => renderer.current?.zoom(factor, at),
    tap: (at) => {
      const tag = renderer.current?.tagAt(at);
      if (tag !== null && tag !== undefined) toggleTag(tag);
    },
    draw: (start, end, phase) => {
      const { draft } = useMapUi.getState();
      if (renderer.current === null) return;
      before ??= { draft };
      drawWithTool(renderer.current.toWorld(start), renderer.current.toWorld(end), setsHeading(start, end));
      if (phase === "end") before = null;
    },
    cancelDraw: () => {
      useMapUi.setState({ draft: before?.draft ?? null });
      before = null;
    },
  });
}
