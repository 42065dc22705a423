/** Tags as plates, flowers on stems, and the outlines of boxes. */
import { useEffect, useMemo } from "react";
import { BufferAttribute, BufferGeometry } from "three";
import { cellColor } from "@/map/draw/ink";
import { WALLED } from "@/map/grid";
import { liveMap } from "@/map/live_map";
import { STEM_COLOR } from "@/map/species";
import { Instances } from "./instances";
import { keepWhileSame } from "./keep_while_same";
import { outlineSegments, placesOf } from "./plant_places";
import { useLiveScene } from "./use_live";
import { WALL_M } from "./walls";

/** Above the tops of the walls, which they lie on. */
const OUTLINE_M = WALL_M + 0.006;

// Ages change with every message, but nothing that is built here.
const readPlants = keepWhileSame(() => liveMap.tags.map(({ at, normal, flowers }) => ({ at, normal, flowers })));
const readOutlines = keepWhileSame(() => [
  ...liveMap.boxes.map((box) => box.corners),
  ...liveMap.tags.map((tag) => tag.footprint).filter((corners) => corners.length >= 3),
]);

export function Plants() {
  const plants = useLiveScene(readPlants);
  const outlines = useLiveScene(readOutlines);
  const { stems, blooms, plates } = useMemo(() => placesOf(plants), [plants]);
  const lines = useMemo(
    () => new BufferGeometry().setAttribute("position", new BufferAttribute(outlineSegments(outlines, OUTLINE_M), 3)),
    [outlines],
  );
  useEffect(() => () => lines.dispose(), [lines]);
  return (
    <>
      <Instances places={plates}>
        <boxGeometry args={[0.012, 0.09, 0.09]} />
        <meshBasicMaterial color="#eff5f0" />
      </Instances>
      <Instances places={stems}>
        <cylinderGeometry args={[0.008, 0.008, 1, 5]} />
        <meshBasicMaterial color={STEM_COLOR} />
      </Instances>
      <Instances places={blooms}>
        <sphereGeometry args={[1, 10, 8]} />
        <meshBasicMaterial />
      </Instances>
      <lineSegments geometry={lines}>
        <lineBasicMaterial color={cellColor(WALLED)} transparent opacity={0.7} />
      </lineSegments>
    </>
  );
}
