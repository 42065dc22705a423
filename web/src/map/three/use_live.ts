import { useThree } from "@react-three/fiber";
import { useEffect, useEffectEvent, useSyncExternalStore } from "react";
import { type Change, liveMap } from "@/map/live_map";
import { requestFrame } from "./frames";

function listen(changed: () => void): () => void {
  return liveMap.listen((change) => change === "scene" && changed());
}

/** A value of the live map that changes with its scene; `read` must return the same value while nothing changed. */
export function useLiveScene<Value>(read: () => Value): Value {
  return useSyncExternalStore(listen, read);
}

/** Update objects of the scene with every change of some kinds, and draw the next frame. */
export function useLiveUpdate(kinds: readonly Change[], update: () => void): void {
  const invalidate = useThree((state) => state.invalidate);
  const apply = useEffectEvent(update);
  const key = kinds.join();
  useEffect(() => {
    apply();
    return liveMap.listen((change) => {
      if (!key.split(",").includes(change)) return;
      apply();
      requestFrame(invalidate);
    });
  }, [key, invalidate]);
}
