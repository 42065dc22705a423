import { act, createRoot, extend } from "@react-three/fiber";
import * as THREE from "three";
import { type OrthographicCamera, type WebGLRenderer } from "three";
import { afterAll, beforeAll, expect, it, vi } from "vitest";
import { gridMessage } from "@/map/grid_fixture";
import { liveMap } from "@/map/live_map";
import type { Presentation } from "@/map/renderer";
import { Greenhouse } from "./greenhouse";
import { Labels } from "./labels";

/** A canvas that counts how often it is drawn anew. */
function countingCanvas() {
  const counts = { clear: 0 };
  const context: unknown = new Proxy(
    {},
    {
      get: (_, name) => {
        if (name === "clearRect") return () => (counts.clear += 1);
        if (name === "measureText") return () => ({ width: 20 });
        return () => {};
      },
      set: () => true,
    },
  );
  const canvas = { clientWidth: 800, clientHeight: 600, width: 0, height: 0, style: {}, getContext: () => context };
  return { counts, canvas: canvas as unknown as HTMLCanvasElement };
}

const SHOWN: Presentation = {
  ...{ layer: null, isFollowing: false, draft: null, preview: null, sent: null, approach: null, selected: null, current: "" },
  ...{ isStopped: false, isPoseStale: false, turned: false, isSmall: false },
};

beforeAll(() => {
  extend(THREE as never);
  vi.stubGlobal("IS_REACT_ACT_ENVIRONMENT", true);
  vi.stubGlobal("requestAnimationFrame", () => 0);
  vi.stubGlobal("devicePixelRatio", 1);
  vi.stubGlobal("ImageData", Object);
  const element = { style: {}, remove: () => {}, append: () => {}, classList: { contains: () => false } };
  vi.stubGlobal("document", { createElement: () => ({ ...element, getContext: () => null }), documentElement: element, body: element });
  vi.stubGlobal("getComputedStyle", () => ({ color: "rgb(1, 2, 3)", fontSize: "16px", fontFamily: "sans-serif" }));
  vi.stubGlobal("window", globalThis);
});

afterAll(() => {
  vi.unstubAllGlobals();
  liveMap.forget();
});

it("draws labels anew only where something moved, and the greenhouse from each version of the map", async () => {
  const { counts, canvas } = countingCanvas();
  const renderer = { render: () => {}, setSize: () => {}, setPixelRatio: () => {}, shadowMap: {}, xr: { addEventListener: () => {}, removeEventListener: () => {} } };
  const root = createRoot({ style: {} } as HTMLCanvasElement);
  const size = { width: 800, height: 600, top: 0, left: 0 };
  await root.configure({ gl: renderer as unknown as WebGLRenderer, frameloop: "never", size, orthographic: true });
  const [overlay, places] = [{ current: canvas }, { current: new Map() }];
  const store = await act(async () =>
    root.render(
      <>
        <Greenhouse />
        <Labels overlayRef={overlay} placesRef={places} presentation={SHOWN} />
      </>,
    ),
  );
  let time = 0;
  const clearsOfFrame = async () => {
    const before = counts.clear;
    await act(async () => store.getState().advance((time += 16)));
    return counts.clear - before;
  };
  expect(await clearsOfFrame()).toBe(1);
  expect(await clearsOfFrame()).toBe(0);
  liveMap.pose = { x: 0, y: 0, yaw: 0 };
  expect(await clearsOfFrame()).toBe(1);
  liveMap.scan = { echoes: new Float32Array(20), from: { x: 0, y: 0 }, receivedMs: 0 };
  liveMap.pose = { x: 0.0001, y: 0, yaw: 1 };
  expect(await clearsOfFrame()).toBe(0);
  (store.getState().camera as OrthographicCamera).zoom += 1;
  expect(await clearsOfFrame()).toBe(1);
  expect(store.getState().scene.children).toHaveLength(0);

  await act(async () => liveMap.takeGrid(gridMessage(["###", "#.#", "###"]), 0));
  const first = store.getState().scene.children.map(({ uuid }) => uuid);
  expect(first).toHaveLength(5);
  await act(async () => liveMap.takeGrid(gridMessage(["###", "#.#", "###"]), 1));
  expect(store.getState().scene.children.map(({ uuid }) => uuid)).toEqual(first);
  await act(async () => liveMap.takeGrid(gridMessage(["###", "#..", "###"]), 2));
  expect(store.getState().scene.children.map(({ uuid }) => uuid)).not.toContain(first[0]);
  await act(async () => root.unmount());
});
