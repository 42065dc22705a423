import { act, createRoot, extend } from "@react-three/fiber";
import type { ReactNode } from "react";
import * as THREE from "three";
import { type InstancedMesh, type LineSegments, Mesh, type Object3D, type WebGLRenderer } from "three";
import { afterEach, beforeAll, describe, expect, it, vi } from "vitest";
import { liveMap } from "@/map/live_map";
import type { Tag } from "@/map/twin";
import { Plan, Scan, TrailLine } from "./lines";
import { Plants } from "./plants";
import { RobotModel, poseBodies } from "./robot_model";

/** Draws nothing: what it is given to draw is looked at instead. */
function fakeRenderer() {
  return { render: vi.fn(), setSize: () => {}, setPixelRatio: () => {}, shadowMap: {}, xr: { addEventListener: () => {}, removeEventListener: () => {} } };
}

let end = async () => {};

async function show(content: ReactNode) {
  const renderer = fakeRenderer();
  const root = createRoot({ style: {} } as HTMLCanvasElement);
  await root.configure({ gl: renderer as unknown as WebGLRenderer, frameloop: "never", size: { width: 800, height: 600, top: 0, left: 0 } });
  let time = 0;
  const store = await act(async () => root.render(content));
  end = async () => act(async () => root.unmount());
  const frame = async () => act(async () => store.getState().advance((time += 16)));
  await frame();
  return { scene: store.getState().scene as Object3D, frame };
}

function drawsOf(scene: Object3D): Mesh[] {
  const found: Mesh[] = [];
  scene.traverseVisible((object) => object instanceof Mesh && found.push(object));
  return found;
}

function tag(id: string, flowers: number): Tag {
  const at = { x: Number(id), y: 1, z: 0.2 };
  const each = (index: number) => ({ x: at.x + index * 0.1, y: 1, z: 0.3, heightM: 0.1, species: "tulip_red", hasBug: false });
  const rest = { readings: {}, species: "", flowerCount: flowers, bugCount: 0, hasBug: false, footprint: [], ageS: null };
  return { id, at, normal: { x: 0, y: 1 }, flowers: Array.from({ length: flowers }, (_, index) => each(index)), health: { state: "no_data" } as Tag["health"], ...rest };
}

beforeAll(() => {
  extend(THREE as never);
  vi.stubGlobal("IS_REACT_ACT_ENVIRONMENT", true);
  vi.stubGlobal("requestAnimationFrame", () => 0);
});

afterEach(async () => {
  await end();
  liveMap.forget();
});

describe("the scene in 3D", () => {
  it("draws each body of the robot by one call", async () => {
    const meshes = { current: new Map<string, Mesh>() };
    const { scene } = await show(<RobotModel meshes={meshes} />);
    expect(drawsOf(scene)).toHaveLength(7);
    expect([...meshes.current.values()].map((mesh) => mesh.uuid)).toEqual(drawsOf(scene).map((mesh) => mesh.uuid));
    poseBodies(meshes.current, new Map([["shoulder_pan_joint", Math.PI / 2]]));
    expect(meshes.current.get("wrist")!.position.z).toBeCloseTo(0.4686, 3);
    expect(meshes.current.get("wrist")!.quaternion.z).toBeCloseTo(Math.SQRT1_2);
  });

  it("draws all plants by three calls, however many they become", async () => {
    liveMap.takeTags([tag("1", 2), tag("2", 3)], 0);
    const { scene, frame } = await show(<Plants />);
    const counts = () => drawsOf(scene).map((mesh) => (mesh as InstancedMesh).count);
    expect(counts()).toEqual([2, 5, 5]);
    await act(async () => liveMap.takeTags([tag("1", 2), tag("2", 30), tag("3", 0)], 1));
    await frame();
    expect(counts()).toEqual([3, 32, 32]);
    expect((drawsOf(scene)[2] as InstancedMesh).instanceColor).not.toBeNull();
  });

  it("outlines boxes", async () => {
    liveMap.takeBoxes([{ id: "1", corners: [{ x: 0, y: 0 }, { x: 1, y: 0 }, { x: 1, y: 1 }, { x: 0, y: 1 }], heightM: 0.3 }]);
    const { scene } = await show(<Plants />);
    const lines = scene.getObjectByProperty("type", "LineSegments") as LineSegments;
    expect(lines.geometry.getAttribute("position").count).toBe(8);
  });

  it("moves plan, trail and scan once per frame, in geometries that stay", async () => {
    const points = (count: number) => ({ points: Array.from({ length: count }, (_, index) => ({ x: index * 0.1, y: 0 })), receivedMs: performance.now() });
    const scan = (count: number) => ({ echoes: new Float32Array(count * 2).fill(1), from: { x: 0, y: 0 }, receivedMs: performance.now() });
    liveMap.plan = points(10);
    liveMap.scan = scan(20);
    const { scene, frame } = await show(
      <>
        <Plan isStopped={false} color="#fff" />
        <TrailLine color="#fff" />
        <Scan color="#0ff" isStale={false} />
      </>,
    );
    const [plan] = drawsOf(scene);
    expect(plan?.geometry.drawRange.count).toBe(9 * 6);
    const echoes = scene.getObjectByProperty("type", "Points") as Mesh;
    expect([echoes.visible, echoes.geometry.drawRange.count]).toEqual([true, 20]);
    const before = plan?.geometry;
    liveMap.plan = points(6);
    liveMap.scan = scan(30);
    liveMap.notify("motion");
    expect(plan?.geometry.drawRange.count).toBe(9 * 6);
    await frame();
    expect(plan?.geometry).toBe(before);
    expect(plan?.geometry.drawRange.count).toBe(5 * 6);
    expect(echoes.geometry.drawRange.count).toBe(30);
  });
});
