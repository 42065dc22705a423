import { BufferGeometry } from "three";
import { describe, expect, it } from "vitest";
import { type Content, fillGeometry } from "./fill_geometry";

function corners(count: number, value = 1): Content {
  return { position: new Float32Array(count * 3).fill(value), color: new Float32Array(count * 4).fill(value), indices: new Uint32Array(count * 3).fill(count - 1) };
}

function filled(content: Content): { geometry: BufferGeometry; disposals: () => number } {
  const geometry = new BufferGeometry();
  let count = 0;
  geometry.addEventListener("dispose", () => (count += 1));
  fillGeometry(geometry, content);
  return { geometry, disposals: () => count };
}

describe("a geometry that changes with every frame", () => {
  it("draws what it was filled with last, and no more", () => {
    const { geometry } = filled(corners(50));
    fillGeometry(geometry, corners(10, 7));
    expect(geometry.drawRange).toEqual({ start: 0, count: 30 });
    const position = geometry.getAttribute("position");
    expect([...position.array.slice(0, 30)]).toEqual(Array.from({ length: 30 }, () => 7));
    expect(geometry.getAttribute("color").array[39]).toBe(7);
    expect(geometry.index?.array[29]).toBe(9);
    expect("updateRanges" in position && position.updateRanges).toEqual([{ start: 0, count: 30 }]);
  });

  it("keeps its buffers while the content fits", () => {
    const { geometry, disposals } = filled(corners(50));
    const [position, index, before] = [geometry.getAttribute("position"), geometry.index, disposals()];
    for (const count of [60, 5, 0, 64, 20]) fillGeometry(geometry, { ...corners(count), indices: new Uint32Array(count) });
    expect(geometry.getAttribute("position")).toBe(position);
    expect(geometry.index).toBe(index);
    expect(disposals()).toBe(before);
  });

  it("frees its buffers before it makes larger ones", () => {
    const { geometry, disposals } = filled(corners(50));
    const before = disposals();
    fillGeometry(geometry, corners(500));
    expect(disposals()).toBe(before + 1);
    expect(geometry.drawRange.count).toBe(1500);
    expect(geometry.getAttribute("position").count).toBeGreaterThanOrEqual(500);
  });

  it("draws corners as they follow where it has no indices, and nothing where it has no corners", () => {
    const { geometry } = filled({ position: new Float32Array(9) });
    expect(geometry.drawRange.count).toBe(3);
    fillGeometry(geometry, { position: new Float32Array(0) });
    expect(geometry.drawRange.count).toBe(0);
  });
});
