/** The camera of the view in 3D: parallel, so that a meter is a meter everywhere. */
import { type OrthographicCamera, Plane, Raycaster, Vector2, Vector3 } from "three";
import type { Bounds, Margins, Point, Size } from "@/map/view";

/** From where the greenhouse is seen at first: turned a little, and from above. */
const AZIMUTH_RAD = -0.24;
const PITCH_RAD = 0.74;
const DISTANCE_M = 60;
export const ZOOM_LIMITS = { low: 10, high: 500 } as const;

const FLOOR = new Plane(new Vector3(0, 0, 1), 0);

/** Where the camera stands for a target that it looks at from its first direction. */
function placeCamera(camera: OrthographicCamera, target: Vector3, turned: boolean): void {
  const azimuth = AZIMUTH_RAD + (turned ? Math.PI : 0);
  const away = new Vector3(Math.sin(azimuth) * Math.cos(PITCH_RAD), -Math.cos(azimuth) * Math.cos(PITCH_RAD), Math.sin(PITCH_RAD));
  camera.up.set(0, 0, 1);
  camera.position.copy(target).addScaledVector(away, DISTANCE_M);
  camera.near = 0.1;
  camera.far = 3 * DISTANCE_M;
  camera.lookAt(target);
  camera.updateMatrixWorld();
}

/** Look at all of `bounds` from the first direction; returns the point that is looked at. */
export function fitCamera(camera: OrthographicCamera, bounds: Bounds, heightM: number, size: Size, margins: Margins, turned: boolean): Vector3 {
  const target = new Vector3((bounds.minX + bounds.maxX) / 2, (bounds.minY + bounds.maxY) / 2, 0);
  placeCamera(camera, target, turned);
  const right = new Vector3().setFromMatrixColumn(camera.matrixWorld, 0);
  const up = new Vector3().setFromMatrixColumn(camera.matrixWorld, 1);
  const [rights, ups]: [number[], number[]] = [[], []];
  for (const x of [bounds.minX, bounds.maxX]) {
    for (const y of [bounds.minY, bounds.maxY]) {
      for (const z of [0, heightM]) {
        const corner = new Vector3(x, y, z).sub(target);
        rights.push(corner.dot(right));
        ups.push(corner.dot(up));
      }
    }
  }
  const [left, low] = [Math.min(...rights), Math.min(...ups)];
  const [width, height] = [Math.max(...rights) - left, Math.max(...ups) - low];
  const free = { width: Math.max(1, size.width - margins.left - margins.right), height: Math.max(1, size.height - margins.top - margins.bottom) };
  camera.zoom = Math.min(ZOOM_LIMITS.high, Math.max(ZOOM_LIMITS.low, Math.min(free.width / width, free.height / height)));
  // The middle of what is seen belongs into the middle between the margins.
  const acrossM = left + width / 2 - (margins.left - margins.right) / 2 / camera.zoom;
  const upM = low + height / 2 + (margins.top - margins.bottom) / 2 / camera.zoom;
  const shift = new Vector3().addScaledVector(right, acrossM).addScaledVector(up, upM);
  camera.position.add(shift);
  target.add(shift);
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  return target;
}

/** The point of the floor below a pixel; null where the camera looks along the floor. */
export function floorBelow(camera: OrthographicCamera, size: Size, pixel: Point): Point | null {
  const ray = new Raycaster();
  ray.setFromCamera(new Vector2((pixel.x / size.width) * 2 - 1, 1 - (pixel.y / size.height) * 2), camera);
  const hit = ray.ray.intersectPlane(FLOOR, new Vector3());
  return hit === null ? null : { x: hit.x, y: hit.y };
}

const projected = new Vector3();

export function projectPoint(camera: OrthographicCamera, size: Size, x: number, y: number, z: number): Point {
  projected.set(x, y, z).project(camera);
  return { x: ((projected.x + 1) / 2) * size.width, y: ((1 - projected.y) / 2) * size.height };
}
