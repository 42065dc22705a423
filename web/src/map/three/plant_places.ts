/** Where the plants' parts stand: each kind is one mesh that is drawn many times by one call. */
import { Matrix4, Quaternion, Vector3 } from "three";
import { speciesColor } from "@/map/species";
import type { Tag } from "@/map/twin";
import type { Point } from "@/map/view";
import { stemOf } from "./walls";

export interface Place {
  matrix: Matrix4;
  /** Instead of the color of the mesh. */
  color?: string;
}

export interface PlantPlaces {
  /** Of a stem of 1 m along y. */
  stems: Place[];
  /** Of a sphere with a radius of 1 m. */
  blooms: Place[];
  /** Of a plate that looks along x. */
  plates: Place[];
}

const FORWARD = new Vector3(1, 0, 0);
const UPRIGHT = new Quaternion().setFromAxisAngle(FORWARD, Math.PI / 2);
const UNTURNED = new Quaternion();
const BLOOM_M = new Vector3(0.05, 0.05, 0.065);
/** A plate hangs in front of its wall, and not in the floor. */
const PLATE_OUT_M = 0.02;
const LOWEST_PLATE_M = 0.06;

export function placesOf(tags: readonly Pick<Tag, "at" | "normal" | "flowers">[]): PlantPlaces {
  const places: PlantPlaces = { stems: [], blooms: [], plates: [] };
  for (const { at, normal, flowers } of tags) {
    if (at !== null) places.plates.push({ matrix: plateMatrix(at, normal) });
    for (const flower of flowers) {
      const { baseM, lengthM } = stemOf(flower);
      const middle = new Vector3(flower.x, flower.y, baseM + lengthM / 2);
      places.stems.push({ matrix: new Matrix4().compose(middle, UPRIGHT, new Vector3(1, lengthM, 1)) });
      const top = new Vector3(flower.x, flower.y, baseM + lengthM);
      places.blooms.push({ matrix: new Matrix4().compose(top, UNTURNED, BLOOM_M), color: speciesColor(flower.species) });
    }
  }
  return places;
}

function plateMatrix(at: { x: number; y: number; z: number }, normal: Point | null): Matrix4 {
  const turned = normal === null ? UNTURNED : new Quaternion().setFromUnitVectors(FORWARD, new Vector3(normal.x, normal.y, 0));
  const { x, y } = normal ?? { x: 0, y: 0 };
  return new Matrix4().compose(new Vector3(at.x + x * PLATE_OUT_M, at.y + y * PLATE_OUT_M, Math.max(LOWEST_PLATE_M, at.z)), turned, new Vector3(1, 1, 1));
}

/** Closed outlines at a height as pairs of corners: x, y and z of each. */
export function outlineSegments(outlines: readonly (readonly Point[])[], heightM: number): Float32Array {
  return Float32Array.from(
    outlines.flatMap((corners) =>
      corners.flatMap((from, index) => {
        const to = corners[(index + 1) % corners.length] ?? from;
        return [from.x, from.y, heightM, to.x, to.y, heightM];
      }),
    ),
  );
}
