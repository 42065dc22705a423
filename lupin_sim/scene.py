"""Builds the MuJoCo model of a world with the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np

from lupin_sim.robot_model import add_robot, quaternion, yaw_quaternion
from lupin_sim.tag_plates import plate_image
from lupin_sim.world import TAG_PLATE_M, Box, Flower, Tag, World

_GEOM = mujoco.mjtGeom
WORLD_GROUP = 0  # the lidar sees groups 0 and 1
TAG_GROUP = 1
TIMESTEP_S = 0.002
_SOLID = {"contype": 1, "conaffinity": 2, "group": WORLD_GROUP}
_VISUAL = {"contype": 0, "conaffinity": 0}

# These colors are outside the flower detector's color bands: none is near black, near white, or pale red.
_PETALS = {
    "tulip_red": (0.80, 0.05, 0.09, 1.0),
    "tulip_white": (0.95, 0.95, 0.93, 1.0),
    "tulip_pink": (0.95, 0.56, 0.72, 1.0),
}
_BUG = (0.02, 0.02, 0.03, 1.0)
_STEM = (0.22, 0.52, 0.18, 1.0)
_LEAF = (0.28, 0.58, 0.22, 1.0)
_WOOD = (0.60, 0.44, 0.20, 1.0)
_RIM = (0.50, 0.37, 0.16, 1.0)
_SOIL = (0.36, 0.26, 0.15, 1.0)
_CRATE = (0.26, 0.46, 0.58, 1.0)
_PILLAR = (0.36, 0.50, 0.42, 1.0)
_LAWN = (0.34, 0.50, 0.24, 1.0)
_WALL = (0.46, 0.62, 0.56, 1.0)


@dataclass(frozen=True)
class Look:
    """The quality of rendering: plain for sensors, with shadows and antialiasing for pictures."""

    shadow_px: int = 0
    samples: int = 0
    slices: int = 12
    stacks: int = 6
    width: int = 640
    height: int = 480


SENSOR_LOOK = Look()
PRETTY_LOOK = Look(shadow_px=4096, samples=8, slices=28, stacks=16, width=1280, height=960)


def build(world: World, look: Look = SENSOR_LOOK) -> mujoco.MjModel:
    """Compile a world with the robot. The robot is at the world's origin until its qpos is set."""
    spec = mujoco.MjSpec()
    spec.modelname = world.name
    spec.compiler.degree = False  # the default is degrees
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _light(spec, world, look)
    _floor(spec, world)
    for box in (*world.boxes, *world.walls):
        _box(spec, box)
    for pillar in world.pillars:
        spec.worldbody.add_geom(
            name=pillar.name,
            type=_GEOM.mjGEOM_CYLINDER,
            size=[pillar.radius, pillar.height / 2, 0],
            pos=[pillar.x, pillar.y, pillar.height / 2],
            rgba=list(_PILLAR),
            **_SOLID,
        )
    for tag in world.tags:
        _tag(spec, tag)
    for index, flower in enumerate(world.flowers):
        _flower(spec, flower, f"flower{index}")
    add_robot(spec)
    return spec.compile()


def _light(spec: mujoco.MjSpec, world: World, look: Look) -> None:
    spec.visual.global_.offwidth, spec.visual.global_.offheight = look.width, look.height
    spec.visual.quality.shadowsize = look.shadow_px
    spec.visual.quality.offsamples = look.samples
    # Software rendering is limited by vertices, not by pixels: coarse cylinders halve the time of a picture.
    spec.visual.quality.numslices, spec.visual.quality.numstacks = look.slices, look.stacks
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 40.0
    spec.stat.extent = 1.0  # znear and zfar are multiples of it
    x0, y0, x1, y1 = world.bounds
    spec.stat.center = [(x0 + x1) / 2, (y0 + y1) / 2, 0.0]
    spec.visual.headlight.ambient = [0.47] * 3
    spec.visual.headlight.diffuse = [0.30] * 3
    spec.visual.headlight.specular = [0.0] * 3
    # Half the width that the shadow map of the directional light covers. It is generous because the edges of the map speckle.
    spec.visual.map.shadowclip = max(x1 - x0, y1 - y0) * 1.2
    spec.worldbody.add_light(
        pos=[(x0 + x1) / 2 - 1.5, (y0 + y1) / 2 - 2.0, 6.0],  # against the light's direction from the middle of the floor
        dir=[0.25, 0.33, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.50] * 3,
        specular=[0.0] * 3,
        castshadow=look.shadow_px > 0,
    )
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.42, 0.68, 0.93],
        rgb2=[0.58, 0.78, 0.92],
        width=128,
        height=128,
    )


def _floor(spec: mujoco.MjSpec, world: World) -> None:
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.40, 0.44, 0.36],
        rgb2=[0.355, 0.39, 0.32],
        width=256,
        height=256,
    )
    x0, y0, x1, y1 = world.bounds
    material = spec.add_material(name="floor", texrepeat=[(x1 - x0) / 2, (y1 - y0) / 2], specular=0, reflectance=0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    # A box, not a plane: the renderer splits a plane into a mesh that costs as much as everything else together.
    spec.worldbody.add_geom(
        name="floor",
        type=_GEOM.mjGEOM_BOX,
        size=[(x1 - x0) / 2 + 0.2, (y1 - y0) / 2 + 0.2, 0.01],
        pos=[(x0 + x1) / 2, (y0 + y1) / 2, -0.01],
        material="floor",
        contype=4,
        conaffinity=0,
        group=WORLD_GROUP,
    )
    # A lawn around the greenhouse, for pictures.
    spec.worldbody.add_geom(
        name="lawn",
        type=_GEOM.mjGEOM_BOX,
        size=[30.0, 30.0, 0.01],
        pos=[(x0 + x1) / 2, (y0 + y1) / 2, -0.035],
        rgba=list(_LAWN),
        group=WORLD_GROUP,
        **_VISUAL,
    )


def _box(spec: mujoco.MjSpec, box: Box) -> None:
    color = {"planter": _WOOD, "crate": _CRATE, "wall": _WALL}[box.kind]
    spec.worldbody.add_geom(
        name=box.name,
        type=_GEOM.mjGEOM_BOX,
        size=[box.depth / 2, box.width / 2, box.height / 2],
        pos=[box.x, box.y, box.height / 2],
        quat=yaw_quaternion(box.yaw),
        rgba=list(color),
        **_SOLID,
    )
    if box.kind != "planter":
        return
    for suffix, inset, top, rgba in (("rim", -0.004, 0.0015, _RIM), ("soil", 0.025, 0.004, _SOIL)):
        spec.worldbody.add_geom(
            name=f"{box.name}_{suffix}",
            type=_GEOM.mjGEOM_BOX,
            size=[box.depth / 2 - inset, box.width / 2 - inset, 0.010],
            pos=[box.x, box.y, box.height - 0.010 + top],
            quat=yaw_quaternion(box.yaw),
            rgba=list(rgba),
            group=WORLD_GROUP,
            **_VISUAL,
        )


def _tag(spec: mujoco.MjSpec, tag: Tag) -> None:
    name = f"tag_{tag.id}"
    ok, png = cv2.imencode(".png", plate_image(tag.id))
    if not ok:
        raise RuntimeError(f"OpenCV could not encode the picture of tag {tag.id} as PNG")
    # Raw bytes are refused by add_texture; a PNG in memory is not.
    spec.assets[f"{name}.png"] = png.tobytes()
    spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=f"{name}.png")
    material = spec.add_material(name=name, specular=0, shininess=0, reflectance=0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    outward = np.array([math.cos(tag.yaw), math.sin(tag.yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    half = TAG_PLATE_M / 2
    spec.worldbody.add_geom(
        name=name,
        type=_GEOM.mjGEOM_BOX,
        size=[half, half, 0.001],
        pos=[tag.x, tag.y, tag.z],
        quat=quaternion(np.stack([np.cross(up, outward), up, outward], 1)),
        material=name,
        group=TAG_GROUP,
        **_VISUAL,
    )


def _flower(spec: mujoco.MjSpec, flower: Flower, name: str) -> None:
    x, y, z = flower.x, flower.y, flower.z
    side = (math.cos(flower.facing + 1.2), math.sin(flower.facing + 1.2))

    def part(suffix: str, kind: mujoco.mjtGeom, rgba: tuple[float, ...], **shape: list[float]) -> None:
        spec.worldbody.add_geom(name=f"{name}_{suffix}", type=kind, rgba=list(rgba), group=WORLD_GROUP, **shape, **_VISUAL)

    part("stem", _GEOM.mjGEOM_CAPSULE, _STEM, fromto=[x, y, flower.base_z, x, y, z - 0.02], size=[0.004, 0, 0])
    part(
        "leaf",
        _GEOM.mjGEOM_ELLIPSOID,
        _LEAF,
        size=[0.016, 0.004, 0.045],
        pos=[x + 0.012 * side[0], y + 0.012 * side[1], flower.base_z + 0.045],
        quat=yaw_quaternion(flower.facing + 1.2),
    )
    part("head", _GEOM.mjGEOM_ELLIPSOID, _PETALS[flower.species], size=[0.024, 0.024, 0.032], pos=[x, y, z])
    if flower.bug:
        out = 0.022
        at = [x + out * math.cos(flower.facing), y + out * math.sin(flower.facing), z + 0.002]
        part("bug", _GEOM.mjGEOM_ELLIPSOID, _BUG, size=[0.008, 0.014, 0.018], pos=at, quat=yaw_quaternion(flower.facing))
