/** Gives a geometry other content with every frame, in buffers that are kept: new ones would be made and freed many times a second. */
import { BufferAttribute, type BufferGeometry } from "three";

/** How many numbers a corner has in each attribute. */
const ITEM_SIZES = { position: 3, color: 4 } as const;
type Name = keyof typeof ITEM_SIZES;

export interface Content {
  position: Float32Array;
  color?: Float32Array;
  /** Three corners of each triangle; without them, the corners are drawn as they follow. */
  indices?: Uint32Array;
}

/** Draw this and nothing else. */
export function fillGeometry(geometry: BufferGeometry, content: Content): void {
  const { indices } = content;
  const attributes = (Object.keys(ITEM_SIZES) as Name[]).flatMap((name) => (content[name] === undefined ? [] : [{ name, values: content[name] }]));
  const isTooSmall =
    attributes.some(({ name, values }) => sizeOf(geometry.getAttribute(name)) < values.length) || sizeOf(geometry.index) < (indices?.length ?? 0);
  if (isTooSmall) {
    // Frees the smaller buffers of the graphics processor; three.js makes others for the same geometry.
    geometry.dispose();
    for (const { name, values } of attributes) {
      const itemSize = ITEM_SIZES[name];
      geometry.setAttribute(name, new BufferAttribute(new Float32Array(roomFor(values.length / itemSize) * itemSize), itemSize));
    }
    if (indices !== undefined) geometry.setIndex(new BufferAttribute(new Uint32Array(roomFor(indices.length)), 1));
  }
  for (const { name, values } of attributes) write(geometry.getAttribute(name), values);
  if (indices !== undefined) write(geometry.index, indices);
  geometry.setDrawRange(0, indices?.length ?? content.position.length / 3);
}

function sizeOf(attribute: { array: ArrayLike<number> } | null | undefined): number {
  return attribute?.array.length ?? 0;
}

function write(attribute: unknown, values: Float32Array | Uint32Array): void {
  if (!(attribute instanceof BufferAttribute) || values.length === 0) return;
  attribute.array.set(values);
  attribute.clearUpdateRanges();
  attribute.addUpdateRange(0, values.length);
  attribute.needsUpdate = true;
}

/** With some for growth, so that a trail does not need another buffer at every step. */
function roomFor(count: number): number {
  return Math.max(64, 2 ** Math.ceil(Math.log2(Math.max(1, count))));
}
