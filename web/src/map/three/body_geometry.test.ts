import { BoxGeometry, Color, CylinderGeometry, Group, Mesh, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { BODIES, type Shape } from "@/robot/model";
import { bodyGeometry } from "./body_geometry";

/** The corners of one shape, by the objects that place it. */
function cornersOf(shape: Shape): Vector3[] {
  const { x, y, z } = shape.size;
  const mesh = new Mesh(shape.kind === "box" ? new BoxGeometry(2 * x, 2 * y, 2 * z) : new CylinderGeometry(x, x, 2 * y, 20));
  if (shape.kind === "cylinder") mesh.rotation.set(Math.PI / 2, 0, 0);
  const place = new Group().add(mesh);
  place.position.copy(shape.pose.translation);
  place.quaternion.copy(shape.pose.rotation);
  place.updateMatrixWorld(true);
  const position = mesh.geometry.getAttribute("position");
  return Array.from({ length: position.count }, (_, index) => new Vector3().fromBufferAttribute(position, index).applyMatrix4(mesh.matrixWorld));
}

describe("the geometry of a body", () => {
  it.each(BODIES.map((body) => [body.name, body] as const))("has every shape of %s in its place and color", (_, body) => {
    const geometry = bodyGeometry(body);
    const [position, color] = [geometry.getAttribute("position"), geometry.getAttribute("color")];
    let corner = 0;
    for (const shape of body.shapes) {
      const [red = 0, green = 0, blue = 0] = shape.color;
      const expected = new Color(`rgb(${[red, green, blue].map((value) => Math.round(value * 255)).join(",")})`);
      for (const at of cornersOf(shape)) {
        expect(new Vector3().fromBufferAttribute(position, corner).distanceTo(at)).toBeLessThan(1e-6);
        expect(Math.abs(color.getX(corner) - expected.r) + Math.abs(color.getY(corner) - expected.g) + Math.abs(color.getZ(corner) - expected.b)).toBeLessThan(0.01);
        corner += 1;
      }
    }
    expect(corner).toBe(position.count);
    expect(geometry.getAttribute("normal").count).toBe(position.count);
    expect(Math.max(...(geometry.index?.array ?? []))).toBeLessThan(position.count);
  });
});
