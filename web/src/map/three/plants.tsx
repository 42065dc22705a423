/** Tags as plates, flowers on stems, and the outlines of boxes. */
import { useEffect, useMemo } from "react";
import { BufferAttribute, BufferGeometry, type Quaternion, Quaternion as Rotation, Vector3 } from "three";
import { liveMap } from "@/map/live_map";
import { speciesColor } from "@/map/species";
import type { Tag } from "@/map/twin";
import type { Point } from "@/map/view";
import { useLiveScene } from "./use_live";
import { WALL_M, stemOf } from "./walls";

export function Plants() {
  const tags = useLiveScene(() => liveMap.tags);
  // Ages change with every message, but nothing that is built here.
  const key = JSON.stringify(tags.map(({ id, at, normal, flowers, footprint }) => [id, at, normal, flowers, footprint]));
  return <PlantScene key={key} tags={tags} />;
}

function PlantScene({ tags }: { tags: readonly Tag[] }) {
  const boxes = useLiveScene(() => liveMap.boxes);
  const outlines = [...boxes.map((box) => box.corners), ...tags.map((tag) => tag.footprint).filter((corners) => corners.length >= 3)];
  return (
    <>
      {tags.map((tag) => tag.at !== null && <TagPlate key={tag.id} at={tag.at} normal={tag.normal} />)}
      {tags.flatMap((tag) =>
        tag.flowers.map((flower, index) => {
          const { baseM, lengthM } = stemOf(flower);
          return (
            <group key={`${tag.id} ${index}`} position={[flower.x, flower.y, baseM]}>
              <mesh position={[0, 0, lengthM / 2]} rotation={[Math.PI / 2, 0, 0]}>
                <cylinderGeometry args={[0.008, 0.008, lengthM, 5]} />
                <meshBasicMaterial color="#4f9a5e" />
              </mesh>
              <mesh position={[0, 0, lengthM]} scale={[0.05, 0.05, 0.065]}>
                <sphereGeometry args={[1, 10, 8]} />
                <meshBasicMaterial color={speciesColor(flower.species)} />
              </mesh>
            </group>
          );
        }),
      )}
      {outlines.map((corners, index) => (
        <BoxOutline key={index} corners={corners} />
      ))}
    </>
  );
}

const FORWARD = new Vector3(1, 0, 0);

function TagPlate({ at, normal }: { at: { x: number; y: number; z: number }; normal: Point | null }) {
  const turned = useMemo<Quaternion>(
    () => (normal === null ? new Rotation() : new Rotation().setFromUnitVectors(FORWARD, new Vector3(normal.x, normal.y, 0))),
    [normal],
  );
  return (
    <mesh position={[at.x + (normal?.x ?? 0) * 0.02, at.y + (normal?.y ?? 0) * 0.02, Math.max(0.06, at.z)]} quaternion={turned}>
      <boxGeometry args={[0.012, 0.09, 0.09]} />
      <meshBasicMaterial color="#eff5f0" />
    </mesh>
  );
}

function BoxOutline({ corners }: { corners: readonly Point[] }) {
  const geometry = useMemo(() => {
    const positions = Float32Array.from(corners.flatMap(({ x, y }) => [x, y, WALL_M + 0.006]));
    return new BufferGeometry().setAttribute("position", new BufferAttribute(positions, 3));
  }, [corners]);
  useEffect(() => () => geometry.dispose(), [geometry]);
  return (
    <lineLoop geometry={geometry}>
      <lineBasicMaterial color="#b2d2be" transparent opacity={0.7} />
    </lineLoop>
  );
}
