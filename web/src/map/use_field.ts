/** Asks the twin for the field of the chosen sensor, again and again while it is shown. */
import { useEffect } from "react";
import { create } from "zustand";
import { SERVICES } from "@/generated/graph";
import { errorText } from "@/i18n/error_text";
import { useIsRewound } from "@/state/rewind";
import { call } from "@/robot/commands";
import { useLink } from "@/robot/link";
import type { Sensor } from "./health";
import { readField } from "./heat";
import { liveMap } from "./live_map";
import { useMapUi } from "./map_ui";
import { type Bounds, boundsOf, grow } from "./view";

/** Cell size and period of the fields that are interpolated between tags. */
const FIELD_CELL_M = 0.25;
export const FIELD_PERIOD_MS = 5000;
/** Without a map: how far around tags the twin knows anything. */
const AROUND_TAGS_M = 1.5;

interface FieldState {
  /** performance.now() of the last answer; null before the first. */
  receivedMs: number | null;
  problem: string;
}

export const useFieldState = create<FieldState>(() => ({ receivedMs: null, problem: "" }));

/** What to ask for: all of the map, or the surroundings of the tags; null while there is neither. */
function fieldBounds(): Bounds | null {
  const bounds = liveMap.grid?.bounds ?? boundsOf(liveMap.tags.flatMap((tag) => tag.at ?? []));
  return bounds === null ? null : grow(bounds, liveMap.grid === null ? AROUND_TAGS_M : 0);
}

export function useField(): void {
  const layer = useMapUi((state) => state.layer);
  const linkOpen = useLink((link) => link.state === "open");
  // The twin answers for now only.
  const isRewound = useIsRewound();
  useEffect(() => {
    if (layer === null || !linkOpen || isRewound) return;
    let isWanted = true;
    useFieldState.setState({ receivedMs: null, problem: "" });
    const ask = async (sensor: Sensor) => {
      const bounds = fieldBounds();
      if (bounds === null) return;
      try {
        const answer = await call(SERVICES.GET_FIELD, {
          sensor_type: sensor,
          resolution: FIELD_CELL_M,
          bbox_min_x: bounds.minX,
          bbox_min_y: bounds.minY,
          bbox_max_x: bounds.maxX,
          bbox_max_y: bounds.maxY,
        });
        if (!isWanted) return;
        liveMap.takeField(readField(sensor, answer));
        useFieldState.setState(answer.ok ? { receivedMs: performance.now(), problem: "" } : { problem: answer.error_message });
      } catch (error) {
        if (isWanted) useFieldState.setState({ problem: errorText(error) });
      }
    };
    void ask(layer);
    const timer = setInterval(() => void ask(layer), FIELD_PERIOD_MS);
    return () => {
      isWanted = false;
      clearInterval(timer);
      liveMap.takeField(null);
    };
  }, [layer, linkOpen, isRewound]);
}
