import { useFrame, useThree } from "@react-three/fiber";
import { useEffect, useRef, useSyncExternalStore } from "react";
import { type Change, liveMap } from "@/map/live_map";
import { requestFrame } from "./frames";

function listen(changed: () => void): () => void {
  return liveMap.listen((change) => change === "scene" && changed());
}

/** A value of the live map that changes with its scene; `read` must return the same value while nothing changed. */
export function useLiveScene<Value>(read: () => Value): Value {
  return useSyncExternalStore(listen, read);
}

/** Update objects of the scene in the next frame after a change of some kinds, or of the component: once for all that came. */
export function useLiveUpdate(kinds: readonly Change[], update: () => void): void {
  const invalidate = useThree((state) => state.invalidate);
  const isOld = useRef(true);
  const key = kinds.join();
  useEffect(() => {
    isOld.current = true;
    requestFrame(invalidate);
  });
  useEffect(
    () =>
      liveMap.listen((change) => {
        if (!key.split(",").includes(change)) return;
        isOld.current = true;
        requestFrame(invalidate);
      }),
    [key, invalidate],
  );
  useFrame(() => {
    if (!isOld.current) return;
    isOld.current = false;
    update();
  });
}
