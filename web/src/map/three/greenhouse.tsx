/** The mapped greenhouse: its floor, its walls as high as they are drawn, and the field of a sensor. */
import { useEffect, useMemo } from "react";
import { BufferAttribute, BufferGeometry, CanvasTexture, Color, LinearFilter, NearestFilter, SRGBColorSpace } from "three";
import { METERS, PALETTE } from "@/map/draw/ink";
import { toCanvas } from "@/map/draw/scene";
import { ENCLOSED, type Grid, OUTSIDE, WALLED, fromCells, paint } from "@/map/grid";
import { paintField } from "@/map/heat";
import { type ShownGrid, liveMap } from "@/map/live_map";
import { type Mesh, sidesOf, topsOf } from "@/map/wall_mesh";
import { useLiveScene } from "./use_live";
import { WALL_M } from "./walls";

const FLOOR_ONLY = { ...PALETTE, [WALLED]: PALETTE[OUTSIDE], [ENCLOSED]: PALETTE[OUTSIDE] };

export function Greenhouse() {
  const version = useLiveScene(() => liveMap.grid?.version ?? 0);
  const shown = liveMap.grid;
  if (shown === null) return null;
  return <GridScene key={version} shown={shown} />;
}

function GridScene({ shown }: { shown: ShownGrid }) {
  const { grid, kinds } = shown;
  const floor = useMemo(() => textureOf(grid, paint(grid, kinds, FLOOR_ONLY), false), [grid, kinds]);
  const plane = useMemo(() => planeOf(grid, 0), [grid]);
  const sides = useMemo(() => shadedSides(sidesOf(grid, kinds, [WALLED, ENCLOSED], WALL_M)), [grid, kinds]);
  const walls = useMemo(() => geometryOf(topsOf(grid, kinds, [WALLED], WALL_M)), [grid, kinds]);
  const enclosed = useMemo(() => geometryOf(topsOf(grid, kinds, [ENCLOSED], WALL_M)), [grid, kinds]);
  useEffect(
    () => () => {
      for (const each of [floor, plane, sides, walls, enclosed]) each.dispose();
    },
    [floor, plane, sides, walls, enclosed],
  );
  return (
    <>
      <mesh geometry={plane} renderOrder={0}>
        {/* Its cells are either there or not: without blending, and after the walls, so that none is drawn below them. */}
        <meshBasicMaterial map={floor} alphaTest={0.5} depthWrite={false} />
      </mesh>
      <Heat shown={shown} />
      <Meters shown={shown} />
      <mesh geometry={sides} renderOrder={-1}>
        <meshBasicMaterial vertexColors />
      </mesh>
      <mesh geometry={walls} renderOrder={-1}>
        <meshBasicMaterial color="#9fc0ad" />
      </mesh>
      <mesh geometry={enclosed} renderOrder={-1}>
        <meshBasicMaterial color="#33483b" />
      </mesh>
    </>
  );
}

function Heat({ shown }: { shown: ShownGrid }) {
  const field = useLiveScene(() => liveMap.field);
  const { grid, kinds } = shown;
  const texture = useMemo(() => (field === null ? null : textureOf(grid, paintField(field, grid, kinds), true)), [field, grid, kinds]);
  const plane = useMemo(() => planeOf(grid, 0.004), [grid]);
  useEffect(() => () => texture?.dispose(), [texture]);
  useEffect(() => () => plane.dispose(), [plane]);
  if (texture === null) return null;
  return (
    <mesh geometry={plane} renderOrder={1}>
      <meshBasicMaterial key={texture.uuid} map={texture} transparent depthWrite={false} />
    </mesh>
  );
}

/** A line at every meter of the known floor. */
function Meters({ shown }: { shown: ShownGrid }) {
  const { bounds } = shown;
  const lines = useMemo(() => {
    const points: number[] = [];
    if (bounds !== null) {
      for (let x = Math.ceil(bounds.minX); x <= bounds.maxX; x += 1) points.push(x, bounds.minY, 0.003, x, bounds.maxY, 0.003);
      for (let y = Math.ceil(bounds.minY); y <= bounds.maxY; y += 1) points.push(bounds.minX, y, 0.003, bounds.maxX, y, 0.003);
    }
    return new BufferGeometry().setAttribute("position", new BufferAttribute(Float32Array.from(points), 3));
  }, [bounds]);
  useEffect(() => () => lines.dispose(), [lines]);
  return (
    <lineSegments geometry={lines} renderOrder={2}>
      <lineBasicMaterial {...METERS} transparent depthWrite={false} />
    </lineSegments>
  );
}

function textureOf(grid: Grid, pixels: Uint8ClampedArray<ArrayBuffer>, smooth: boolean): CanvasTexture {
  const texture = new CanvasTexture(toCanvas(grid, pixels));
  texture.colorSpace = SRGBColorSpace;
  texture.magFilter = smooth ? LinearFilter : NearestFilter;
  texture.minFilter = LinearFilter;
  texture.generateMipmaps = false;
  return texture;
}

/** The rectangle of the grid, at a height; its picture has the grid's last row first. */
function planeOf(grid: Grid, z: number): BufferGeometry {
  const corners = [fromCells(grid, 0, 0), fromCells(grid, grid.width, 0), fromCells(grid, grid.width, grid.height), fromCells(grid, 0, grid.height)];
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(Float32Array.from(corners.flatMap(({ x, y }) => [x, y, z])), 3));
  geometry.setAttribute("uv", new BufferAttribute(Float32Array.from([0, 0, 1, 0, 1, 1, 0, 1]), 2));
  geometry.setIndex([0, 1, 2, 0, 2, 3]);
  return geometry;
}

function geometryOf(mesh: Mesh): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(mesh.positions, 3));
  geometry.setIndex(new BufferAttribute(mesh.indices, 1));
  return geometry;
}

/** Sides that look another way have another shade: the light is painted once, not computed in every frame. */
function shadedSides(mesh: Mesh): BufferGeometry {
  const geometry = geometryOf(mesh);
  const [dark, light] = [new Color("#141d18"), new Color("#2c3c32")];
  const colors = new Float32Array(mesh.normals.length);
  const shade = new Color();
  for (let corner = 0; corner < mesh.normals.length; corner += 3) {
    const facing = 0.5 + 0.5 * ((mesh.normals[corner] ?? 0) * 0.42 - (mesh.normals[corner + 1] ?? 0) * 0.9);
    shade.lerpColors(dark, light, facing).toArray(colors, corner);
  }
  geometry.setAttribute("color", new BufferAttribute(colors, 3));
  return geometry;
}
