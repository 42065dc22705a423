import { OrthographicCamera } from "three";
import { expect, it } from "vitest";
import { LiveMap } from "@/map/live_map";
import { CameraRig } from "./camera_rig";

/** The part of an element that the controls of the camera use. */
function fakeElement(): HTMLElement {
  const events = { addEventListener: () => {}, removeEventListener: () => {} };
  return { ...events, style: {}, ownerDocument: events, clientWidth: 800, clientHeight: 600 } as unknown as HTMLElement;
}

it("tells moves by the operator from those that follow the robot", () => {
  const live = new LiveMap();
  const moves: boolean[] = [];
  const moved = (_: unknown, byOperator: boolean) => moves.push(byOperator);
  const since = () => moves.splice(0);
  const rig = new CameraRig(new OrthographicCamera(-400, 400, 300, -300), fakeElement(), live, { moved, taken: () => {} });
  rig.resize({ width: 800, height: 600 }, { top: 0, right: 0, bottom: 0, left: 0 }, false);
  expect(since()).toEqual([true]);

  live.pose = { x: 1, y: 0, yaw: 0 };
  live.notify("motion");
  expect(since()).toEqual([false]);
  rig.setFollowing(true);
  since();
  live.pose = { x: 2, y: 0, yaw: 0 };
  live.notify("motion");
  expect(new Set(since())).toEqual(new Set([false]));
  expect(rig.center()).toEqual({ x: expect.closeTo(2), y: expect.closeTo(0) });

  rig.pan({ x: 10, y: 0 });
  expect(new Set(since())).toEqual(new Set([true]));
  rig.zoom(2);
  expect(since()).toEqual([true]);
  rig.close();
  live.notify("motion");
  expect(since()).toEqual([]);
});
