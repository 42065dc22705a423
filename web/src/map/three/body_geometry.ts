/** A body of the robot as one geometry: its shapes are drawn by one call instead of one each. */
import { BoxGeometry, BufferAttribute, type BufferGeometry, Color, CylinderGeometry, Matrix4, Quaternion, SRGBColorSpace, Vector3 } from "three";
import { mergeGeometries } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import type { Body, Shape } from "@/robot/model";

const ONE = new Vector3(1, 1, 1);

/** The shapes of a body in its frame, each corner with the color of its shape. Dispose of it after use. */
export function bodyGeometry(body: Body): BufferGeometry {
  const parts = body.shapes.map(shapeGeometry);
  const merged = mergeGeometries(parts);
  for (const part of parts) part.dispose();
  return merged;
}

function shapeGeometry({ kind, size: { x, y, z }, pose, color }: Shape): BufferGeometry {
  // MuJoCo's cylinders stand along z, with half their length; those of three.js along y.
  const geometry = kind === "box" ? new BoxGeometry(2 * x, 2 * y, 2 * z) : new CylinderGeometry(x, x, 2 * y, 20).rotateX(Math.PI / 2);
  geometry.applyMatrix4(new Matrix4().compose(new Vector3().copy(pose.translation), new Quaternion().copy(pose.rotation), ONE));
  geometry.deleteAttribute("uv");
  const [red = 0, green = 0, blue = 0] = color;
  const shown = new Color().setRGB(red, green, blue, SRGBColorSpace).toArray();
  const { count } = geometry.getAttribute("position");
  geometry.setAttribute("color", new BufferAttribute(Float32Array.from({ length: count * 3 }, (_, index) => shown[index % 3] ?? 0), 3));
  return geometry;
}
