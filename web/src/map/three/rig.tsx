import { useThree } from "@react-three/fiber";
import { type RefObject, useEffect, useState } from "react";
import type { OrthographicCamera } from "three";
import { liveMap } from "@/map/live_map";
import { useMapUi } from "@/map/map_ui";
import type { Margins, View } from "@/map/view";
import { CameraRig } from "./camera_rig";
import { isSlow, requestFrame } from "./frames";

interface RigProps {
  surfaceRef: RefObject<HTMLDivElement | null>;
  rigRef: RefObject<CameraRig | null>;
  margins: Margins;
  turned: boolean;
  onView: (view: View) => void;
}

/** Gives the scene its camera rig while it is shown. */
export function Rig({ surfaceRef, rigRef, margins, turned, onView }: RigProps) {
  const camera = useThree((state) => state.camera);
  const { width, height } = useThree((state) => state.size);
  const invalidate = useThree((state) => state.invalidate);
  const lowerResolution = useThree((state) => state.performance.regress);
  const isFollowing = useMapUi((state) => state.isFollowing);
  const canMove = useMapUi((state) => state.tool === "move");
  const [rig, setRig] = useState<CameraRig | null>(null);

  useEffect(() => {
    if (surfaceRef.current === null) return;
    const created = new CameraRig(camera as OrthographicCamera, surfaceRef.current, liveMap, {
      moved: (view, byOperator) => {
        onView(view);
        if (!byOperator) {
          requestFrame(invalidate);
          return;
        }
        if (isSlow()) lowerResolution();
        invalidate();
      },
      taken: () => useMapUi.setState({ isFollowing: false }),
    });
    const fit = () => {
      useMapUi.setState({ isFollowing: false });
      created.fit();
    };
    rigRef.current = created;
    setRig(created);
    useMapUi.setState({ controls: { fit, zoom: (factor) => created.zoom(factor), center: () => created.center() } });
    return () => {
      created.close();
      rigRef.current = null;
      useMapUi.setState({ controls: null });
    };
  }, [camera, invalidate, lowerResolution, onView, rigRef, surfaceRef]);

  useEffect(() => rig?.resize({ width, height }, margins, turned), [rig, width, height, margins, turned]);
  useEffect(() => rig?.setEnabled(canMove), [rig, canMove]);
  useEffect(() => rig?.setFollowing(isFollowing), [rig, isFollowing]);
  return null;
}
