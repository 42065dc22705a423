/** What moves on the floor beside the robot: its plan, its trail, and what the lidar sees. */
import { useRef } from "react";
import { Color, type Mesh, type MeshBasicMaterial, type Points } from "three";
import { FRESH_TRAIL_MS, OLD_PLAN, SCAN_LIGHT_M, SCAN_LIGHT_OPACITY } from "@/map/draw/ink";
import { LIDAR } from "@/generated/robot";
import { SCAN_STALE_MS, liveMap } from "@/map/live_map";
import { ribbon } from "@/map/ribbon";
import { shownPlan } from "@/map/route";
import type { Point } from "@/map/view";
import { viewNow } from "@/hooks/view_clock";
import { type Content, fillGeometry } from "./fill_geometry";
import { useLiveUpdate } from "./use_live";

const PLAN_WIDTH_M = 0.05;
const TRAIL_WIDTH_M = 0.035;

function setRibbon(mesh: Mesh, points: readonly Point[], widthM: number, z: number): void {
  const { positions, indices } = ribbon(points, widthM, z);
  fillGeometry(mesh.geometry, { position: positions, indices });
  mesh.visible = indices.length > 0;
}

export function Plan({ isStopped, color }: { isStopped: boolean; color: string }) {
  const band = useRef<Mesh>(null);
  useLiveUpdate(["motion"], () => {
    if (band.current === null) return;
    const shown = shownPlan(liveMap.plan, liveMap.pose, viewNow());
    setRibbon(band.current, shown?.left ?? [], PLAN_WIDTH_M, 0.012);
    (band.current.material as MeshBasicMaterial).color.set(isStopped || shown?.isFollowed === false ? OLD_PLAN : color);
  });
  return (
    <mesh ref={band} renderOrder={4} frustumCulled={false}>
      <bufferGeometry />
      <meshBasicMaterial color={color} transparent depthWrite={false} />
    </mesh>
  );
}

export function TrailLine({ color }: { color: string }) {
  const band = useRef<Mesh>(null);
  useLiveUpdate(["motion"], () => {
    if (band.current === null) return;
    const nowMs = viewNow();
    const { points } = liveMap.trail;
    const since = points.findLastIndex((point) => point.begins || nowMs - point.atMs > FRESH_TRAIL_MS);
    setRibbon(band.current, points.slice(Math.max(0, since)), TRAIL_WIDTH_M, 0.008);
  });
  return (
    <mesh ref={band} renderOrder={3} frustumCulled={false}>
      <bufferGeometry />
      <meshBasicMaterial color={color} transparent opacity={0.6} depthWrite={false} />
    </mesh>
  );
}

/** Echoes as points at the height of the lidar, and the floor that it sees as a pool of light. */
export function Scan({ color, isStale }: { color: string; isStale: boolean }) {
  const points = useRef<Points>(null);
  const pool = useRef<Mesh>(null);
  useLiveUpdate(["motion"], () => {
    const { scan } = liveMap;
    if (points.current === null || pool.current === null) return;
    const isShown = scan !== null && !isStale && viewNow() - scan.receivedMs < SCAN_STALE_MS && scan.echoes.length > 4;
    points.current.visible = isShown;
    pool.current.visible = isShown;
    if (!isShown) return;
    const count = scan.echoes.length / 2;
    const positions = new Float32Array(count * 3);
    for (let index = 0; index < count; index += 1) {
      positions.set([scan.echoes[index * 2] ?? 0, scan.echoes[index * 2 + 1] ?? 0, LIDAR.at[2]], index * 3);
    }
    fillGeometry(points.current.geometry, { position: positions });
    fillGeometry(pool.current.geometry, fanOf(scan.echoes, scan.from, new Color(color)));
  });
  return (
    <>
      <points ref={points} renderOrder={8} frustumCulled={false}>
        <bufferGeometry />
        <pointsMaterial color={color} size={2.5} sizeAttenuation={false} depthTest={false} transparent />
      </points>
      <mesh ref={pool} renderOrder={2} frustumCulled={false}>
        <bufferGeometry />
        <meshBasicMaterial vertexColors transparent depthWrite={false} />
      </mesh>
    </>
  );
}

/** Triangles from the lidar to its echoes, the fainter the farther. */
function fanOf(echoes: Float32Array, from: Point, { r, g, b }: Color): Content {
  const count = echoes.length / 2;
  const position = new Float32Array((count + 1) * 3);
  const color = new Float32Array((count + 1) * 4);
  position.set([from.x, from.y, 0.002]);
  color.set([r, g, b, SCAN_LIGHT_OPACITY]);
  for (let index = 0; index < count; index += 1) {
    const [x, y] = [echoes[index * 2] ?? 0, echoes[index * 2 + 1] ?? 0];
    const distance = Math.hypot(x - from.x, y - from.y);
    position.set([x, y, 0.002], (index + 1) * 3);
    color.set([r, g, b, SCAN_LIGHT_OPACITY * Math.max(0, 1 - distance / SCAN_LIGHT_M)], (index + 1) * 4);
  }
  const indices = new Uint32Array(count * 3);
  for (let index = 0; index < count; index += 1) indices.set([0, index + 1, ((index + 1) % count) + 1], index * 3);
  return { position, color, indices };
}
