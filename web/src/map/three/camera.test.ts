import { OrthographicCamera, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { fitCamera, floorBelow, projectPoint } from "./camera";

const SIZE = { width: 800, height: 600 };
const BOUNDS = { minX: -1, minY: -1, maxX: 7, maxY: 6 };
const MARGINS = { top: 60, right: 20, bottom: 40, left: 20 };

/** As react-three-fiber makes it: a pixel is a unit at zoom 1. */
function cameraOf(): OrthographicCamera {
  return new OrthographicCamera(-400, 400, 300, -300);
}

describe("the camera in 3D", () => {
  it.each([false, true])("shows all of the map between the margins, turned: %s", (turned) => {
    const camera = cameraOf();
    fitCamera(camera, BOUNDS, 0.3, SIZE, MARGINS, turned);
    for (const x of [BOUNDS.minX, BOUNDS.maxX]) {
      for (const y of [BOUNDS.minY, BOUNDS.maxY]) {
        const pixel = projectPoint(camera, SIZE, x, y, 0);
        expect(pixel.x).toBeGreaterThan(19);
        expect(pixel.x).toBeLessThan(781);
        expect(pixel.y).toBeGreaterThan(59);
        expect(pixel.y).toBeLessThan(561);
      }
    }
  });

  it("finds the floor below a pixel, and looks down on it from the south", () => {
    const camera = cameraOf();
    fitCamera(camera, BOUNDS, 0.3, SIZE, MARGINS, false);
    const pixel = projectPoint(camera, SIZE, 3, 2, 0);
    const point = floorBelow(camera, SIZE, pixel)!;
    expect(point.x).toBeCloseTo(3);
    expect(point.y).toBeCloseTo(2);
    expect(projectPoint(camera, SIZE, 3, 4, 0).y).toBeLessThan(pixel.y);
    expect(projectPoint(camera, SIZE, 3, 2, 0.3).y).toBeLessThan(pixel.y);
  });

  it("turns the map by 180 degrees", () => {
    const camera = cameraOf();
    const target = fitCamera(camera, BOUNDS, 0.3, SIZE, MARGINS, true);
    expect(target).toBeInstanceOf(Vector3);
    expect(projectPoint(camera, SIZE, 3, 4, 0).y).toBeGreaterThan(projectPoint(camera, SIZE, 3, 2, 0).y);
  });
});
