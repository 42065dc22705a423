"""The robot's URDF, and the poses of its links, both taken from the MuJoCo model, so that they cannot differ from it."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from lupin_runtime import graph
from lupin_runtime.transforms import Transform
from lupin_sim import mirte, robot_model

# The vendor's link that turns with the gripper's joint. The model has two sliding fingers instead, which follow that joint.
GRIPPER_LINK = "gripper"
_FINGERS = ("finger_left", "finger_right")
_OPENING_M = mirte.aperture_from_gripper(mirte.GRIPPER_LOWER_RAD) / 2
# URDF can only say that a finger follows linearly; the table in `mirte.py` is up to 5 mm away from that.
_FINGER_PER_RAD = -_OPENING_M / (mirte.GRIPPER_UPPER_RAD - mirte.GRIPPER_LOWER_RAD)

_Array = NDArray[np.float64]


def _text(values: _Array | tuple[float, ...]) -> str:
    return " ".join(f"{float(value):.6g}" for value in values)


def _rpy(quaternion: _Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw (URDF: fixed axes) of a quaternion (w, x, y, z)."""
    w, x, y, z = (float(value) for value in quaternion)
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def _links(model: mujoco.MjModel) -> list[int]:
    """Return the bodies of the robot, parents first: `base_link` and all bodies below it."""
    base = model.body(graph.BASE_FRAME).id
    found = [base]
    found += [body for body in range(model.nbody) if body != base and _is_below(model, body, base)]
    return found


def _is_below(model: mujoco.MjModel, body: int, base: int) -> bool:
    while body:
        body = int(model.body_parentid[body])
        if body == base:
            return True
    return False


def _origin(parent: ElementTree.Element, xyz: _Array | tuple[float, ...], quaternion: _Array) -> None:
    ElementTree.SubElement(parent, "origin", xyz=_text(xyz), rpy=_text(_rpy(quaternion)))


def _add_visuals(link: ElementTree.Element, model: mujoco.MjModel, body: int) -> None:
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] != body or model.geom_group[geom] != robot_model.GROUP:
            continue
        size = model.geom_size[geom]
        visual = ElementTree.SubElement(link, "visual")
        _origin(visual, model.geom_pos[geom], model.geom_quat[geom])
        geometry = ElementTree.SubElement(visual, "geometry")
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            ElementTree.SubElement(geometry, "box", size=_text(2 * size))
        else:
            ElementTree.SubElement(geometry, "cylinder", radius=f"{size[0]:.6g}", length=f"{2 * size[1]:.6g}")
        material = ElementTree.SubElement(visual, "material", name=f"{link.get('name')}_{geom}")
        ElementTree.SubElement(material, "color", rgba=_text(model.geom_rgba[geom]))


def _add_joint(robot: ElementTree.Element, name: str, kind: str, parent: str, child: str) -> ElementTree.Element:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint


def _add_limit(joint: ElementTree.Element, lower: float, upper: float, velocity: float) -> None:
    effort = f"{mirte.SERVO_EFFORT_NM:.6g}"
    ElementTree.SubElement(
        joint, "limit", lower=f"{lower:.6g}", upper=f"{upper:.6g}", effort=effort, velocity=f"{velocity:.6g}"
    )


def _add_moving_joint(robot: ElementTree.Element, model: mujoco.MjModel, body: int) -> None:
    index = int(model.body_jntadr[body])
    slides = model.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE
    child, parent = model.body(body).name, model.body(int(model.body_parentid[body])).name
    name = f"{child}_joint" if child in _FINGERS else model.joint(index).name
    joint = _add_joint(robot, name, "prismatic" if slides else "revolute", parent, child)
    _origin(joint, model.body_pos[body], model.body_quat[body])
    ElementTree.SubElement(joint, "axis", xyz=_text(model.jnt_axis[index]))
    lower, upper = (float(value) for value in model.jnt_range[index])
    _add_limit(joint, lower, upper, mirte.SERVO_SPEED_RADPS)
    if child in _FINGERS:
        offset = -_FINGER_PER_RAD * mirte.GRIPPER_UPPER_RAD
        ElementTree.SubElement(
            joint, "mimic", joint=graph.GRIPPER_JOINT, multiplier=f"{_FINGER_PER_RAD:.6g}", offset=f"{offset:.6g}"
        )


def _add_sensor(robot: ElementTree.Element, frame: str, position: tuple[float, ...], rotation: tuple[float, ...]) -> None:
    ElementTree.SubElement(robot, "link", name=frame)
    joint = _add_joint(robot, f"{frame}_joint", "fixed", graph.BASE_FRAME, frame)
    x, y, z, w = rotation
    _origin(joint, position, np.array([w, x, y, z]))


def robot_description(model: mujoco.MjModel, sensors: dict[str, Transform]) -> str:
    """Return the URDF: base, arm and fingers of the model, and the fixed frames of `sensors` on the base."""
    robot = ElementTree.Element("robot", name="mirte_master")
    for body in _links(model):
        link = ElementTree.SubElement(robot, "link", name=model.body(body).name)
        _add_visuals(link, model, body)
        if model.body(body).name != graph.BASE_FRAME:
            _add_moving_joint(robot, model, body)
    ElementTree.SubElement(robot, "link", name=GRIPPER_LINK)
    joint = _add_joint(robot, graph.GRIPPER_JOINT, "revolute", mirte.SERVOS[-1].servo, GRIPPER_LINK)
    _origin(joint, (0.0, 0.0, mirte.WRIST_TO_JAW_M), np.array([1.0, 0.0, 0.0, 0.0]))
    ElementTree.SubElement(joint, "axis", xyz="1 0 0")
    _add_limit(joint, mirte.GRIPPER_LOWER_RAD, mirte.GRIPPER_UPPER_RAD, mirte.GRIPPER_SPEED_RADPS)
    for frame, mount in sensors.items():
        _add_sensor(robot, frame, mount.translation, mount.rotation)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


class LinkPoses:
    """The poses of the moving links relative to their parents, as the URDF connects them."""

    def __init__(self, model: mujoco.MjModel) -> None:
        bodies = [body for body in _links(model) if model.body(body).name != graph.BASE_FRAME]
        self._pairs = [(int(model.body_parentid[body]), body) for body in bodies]
        self.frames = [(model.body(parent).name, model.body(body).name) for parent, body in self._pairs]
        self.frames.append((mirte.SERVOS[-1].servo, GRIPPER_LINK))

    def read(self, data: mujoco.MjData, gripper_rad: float) -> list[Transform]:
        """Return one transform for each pair of `frames`."""
        poses = [self._relative(data, parent, body) for parent, body in self._pairs]
        turned = (math.sin(gripper_rad / 2), 0.0, 0.0, math.cos(gripper_rad / 2))
        return [*poses, Transform((0.0, 0.0, mirte.WRIST_TO_JAW_M), turned)]

    @staticmethod
    def _relative(data: mujoco.MjData, parent: int, body: int) -> Transform:
        to_parent = data.xmat[parent].reshape(3, 3).T
        position = to_parent @ (data.xpos[body] - data.xpos[parent])
        w, x, y, z = robot_model.quaternion(to_parent @ data.xmat[body].reshape(3, 3))
        return Transform((float(position[0]), float(position[1]), float(position[2])), (x, y, z, w))
