import { useThree } from "@react-three/fiber";
import { type ReactNode, useLayoutEffect, useRef } from "react";
import { Color, type InstancedMesh } from "three";
import type { Place } from "./plant_places";

interface InstancesProps {
  places: readonly Place[];
  children: ReactNode;
}

/** One mesh at many places, drawn by one call. Its geometry and its material are the children. */
export function Instances({ places, children }: InstancesProps) {
  // Room for more, so that a new flower does not need another mesh.
  const room = Math.max(16, 2 ** Math.ceil(Math.log2(Math.max(1, places.length))));
  return (
    <MeshWithRoom key={room} room={room} places={places}>
      {children}
    </MeshWithRoom>
  );
}

function MeshWithRoom({ room, places, children }: InstancesProps & { room: number }) {
  const mesh = useRef<InstancedMesh>(null);
  const invalidate = useThree((state) => state.invalidate);
  useLayoutEffect(() => {
    const shown = mesh.current;
    if (shown === null) return;
    const color = new Color();
    places.forEach((place, index) => {
      shown.setMatrixAt(index, place.matrix);
      if (place.color !== undefined) shown.setColorAt(index, color.set(place.color));
    });
    shown.count = places.length;
    shown.instanceMatrix.needsUpdate = true;
    if (shown.instanceColor !== null) shown.instanceColor.needsUpdate = true;
    invalidate();
  }, [places, invalidate]);
  // Not culled: its bounds would have to be computed anew with every change.
  return (
    <instancedMesh ref={mesh} args={[undefined, undefined, room]} frustumCulled={false}>
      {children}
    </instancedMesh>
  );
}
