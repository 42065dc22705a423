/** A body of the robot as one geometry: its shapes are drawn by one call instead of one each. */
import { BoxGeometry, BufferAttribute, type BufferGeometry, Color, CylinderGeometry, Matrix4, Quaternion, SRGBColorSpace, Vector3 } from "three";
import { mergeGeometries } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import type { Body, Shape } from "@/generated/robot_model";

const ONE = new Vector3(1, 1, 1);

/** The shapes of a body in its frame, each corner with the color of its shape. Dispose of it after use. */
export function bodyGeometry(body: Body): BufferGeometry {
  const parts = body.shapes.map(shapeGeometry);
  const merged = mergeGeometries(parts);
  for (const part of parts) part.dispose();
  return merged;
}

function shapeGeometry(shape: Shape): BufferGeometry {
  const [a = 0, b = 0, c = 0] = shape.size;
  // MuJoCo's cylinders stand along z, with half their length; those of three.js along y.
  const geometry = shape.kind === "box" ? new BoxGeometry(2 * a, 2 * b, 2 * c) : new CylinderGeometry(a, a, 2 * b, 20).rotateX(Math.PI / 2);
  geometry.applyMatrix4(new Matrix4().compose(vector(shape.at), quaternion(shape.turned), ONE));
  geometry.deleteAttribute("uv");
  const [red = 0, green = 0, blue = 0] = shape.color;
  const color = new Color().setRGB(red, green, blue, SRGBColorSpace).toArray();
  const { count } = geometry.getAttribute("position");
  geometry.setAttribute("color", new BufferAttribute(Float32Array.from({ length: count * 3 }, (_, index) => color[index % 3] ?? 0), 3));
  return geometry;
}

export function vector([x = 0, y = 0, z = 0]: readonly number[]): Vector3 {
  return new Vector3(x, y, z);
}

export function quaternion([x = 0, y = 0, z = 0, w = 1]: readonly number[]): Quaternion {
  return new Quaternion(x, y, z, w);
}
