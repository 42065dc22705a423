import { CylinderGeometry, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { keepWhileSame } from "./keep_while_same";
import { outlineSegments, placesOf } from "./plant_places";
import { stemOf } from "./walls";

const FLOWER = { x: 2, y: 3, z: 0.4, heightM: 0.1, species: "tulip_red", hasBug: false };

describe("the places of the plants' parts", () => {
  it("put a stem from its box to its bloom", () => {
    const { stems, blooms, plates } = placesOf([{ at: null, normal: null, flowers: [FLOWER] }]);
    const { baseM, lengthM } = stemOf(FLOWER);
    const geometry = new CylinderGeometry(0.008, 0.008, 1, 5).applyMatrix4(stems[0]!.matrix);
    geometry.computeBoundingBox();
    expect(geometry.boundingBox!.min.z).toBeCloseTo(baseM);
    expect(geometry.boundingBox!.max.z).toBeCloseTo(baseM + lengthM);
    expect(geometry.boundingBox!.max.x).toBeCloseTo(2.008, 2);
    const top = new Vector3().setFromMatrixPosition(blooms[0]!.matrix);
    expect(top.toArray()).toEqual([2, 3, baseM + lengthM].map((value) => expect.closeTo(value)));
    expect(blooms[0]!.color).toBe("#e23a3a");
    expect(plates).toEqual([]);
  });

  it("hang a plate in front of its wall, looking out, and above the floor", () => {
    const { plates } = placesOf([
      { at: { x: 1, y: 1, z: 0 }, normal: { x: 0, y: -1 }, flowers: [] },
      { at: { x: 1, y: 1, z: 0.2 }, normal: null, flowers: [] },
    ]);
    const [first, second] = plates.map(({ matrix }) => new Vector3().setFromMatrixPosition(matrix));
    expect(first!.toArray()).toEqual([1, 0.98, 0.06].map((value) => expect.closeTo(value)));
    expect(second!.toArray()).toEqual([1, 1, 0.2].map((value) => expect.closeTo(value)));
    expect(new Vector3(1, 0, 0).transformDirection(plates[0]!.matrix).y).toBeCloseTo(-1);
  });

  it("close every outline", () => {
    const triangle = [{ x: 0, y: 0 }, { x: 1, y: 0 }, { x: 1, y: 1 }];
    const segments = outlineSegments([triangle, triangle], 0.5);
    expect(segments.length).toBe(2 * 3 * 2 * 3);
    expect([...segments.slice(12, 18)]).toEqual([1, 1, 0.5, 0, 0, 0.5]);
    expect(outlineSegments([], 0.5).length).toBe(0);
  });
});

describe("a value that is kept while its content is the same", () => {
  it("is another one only where the content changed", () => {
    let value = [1];
    const read = keepWhileSame(() => [...value]);
    const first = read();
    expect(read()).toBe(first);
    value = [2];
    expect(read()).toEqual([2]);
    expect(read()).not.toBe(first);
  });
});
