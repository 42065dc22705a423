"""The URDF describes the MuJoCo model, and the poses of its links follow the joints."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import quaternion_from_yaw
from lupin_runtime.transforms import Transform
from lupin_sim import mirte, robot_model, urdf

LASER = {graph.LASER_FRAME: Transform(mirte.LIDAR_POSITION, quaternion_from_yaw(mirte.LIDAR_YAW_RAD))}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    robot_model.add_robot(spec)
    return spec.compile()


def rotation(origin: ElementTree.Element) -> np.ndarray:
    r, p, y = (float(value) for value in origin.attrib["rpy"].split())
    about = {
        "x": np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]]),
        "y": np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]]),
        "z": np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]]),
    }
    product: np.ndarray = about["z"] @ about["y"] @ about["x"]
    return product


def test_urdf_is_one_tree_with_the_contracts_joints(model: mujoco.MjModel) -> None:
    robot = ElementTree.fromstring(urdf.robot_description(model, LASER))
    links = [link.attrib["name"] for link in robot.iter("link")]
    joints = {joint.attrib["name"]: joint for joint in robot.iter("joint") if "type" in joint.attrib}
    assert {*graph.ARM_JOINTS, graph.GRIPPER_JOINT} <= joints.keys()
    children = [joint.find("child").attrib["link"] for joint in joints.values()]  # type: ignore[union-attr]
    assert sorted([*children, graph.BASE_FRAME]) == sorted(links) == sorted(set(links))
    for servo in mirte.SERVOS:
        limit = joints[servo.joint].find("limit")
        assert limit is not None
        assert (float(limit.attrib["lower"]), float(limit.attrib["upper"])) == pytest.approx(
            (servo.lower_rad, servo.upper_rad), abs=1e-4
        )
    laser = joints[f"{graph.LASER_FRAME}_joint"].find("origin")
    assert laser is not None
    assert rotation(laser) @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-4)  # the lidar faces left


def test_every_geom_of_the_robot_is_drawn_where_it_is(model: mujoco.MjModel) -> None:
    robot = ElementTree.fromstring(urdf.robot_description(model, {}))
    visuals = list(robot.iter("visual"))
    geoms = [geom for geom in range(model.ngeom) if model.geom_group[geom] == robot_model.GROUP]
    assert len(visuals) == len(geoms)
    for visual in visuals:
        material, origin = visual.find("material"), visual.find("origin")
        assert material is not None and origin is not None
        geom = int(material.attrib["name"].rsplit("_", 1)[1])
        expected = np.zeros(9)
        mujoco.mju_quat2Mat(expected, model.geom_quat[geom])
        assert rotation(origin) == pytest.approx(expected.reshape(3, 3), abs=1e-4)


def test_link_poses_match_the_urdf_at_zero_and_follow_joints(model: mujoco.MjModel) -> None:
    robot = ElementTree.fromstring(urdf.robot_description(model, {}))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    links = urdf.LinkPoses(model)
    at_zero = dict(zip(links.frames, links.read(data, 0.0)))
    for joint in robot.iter("joint"):
        if "type" not in joint.attrib:
            continue
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        assert parent is not None and child is not None and origin is not None
        pose = at_zero[parent.attrib["link"], child.attrib["link"]]
        assert pose.translation == pytest.approx([float(value) for value in origin.attrib["xyz"].split()], abs=1e-4)
    data.joint("shoulder_lift_joint").qpos = 0.5
    mujoco.mj_forward(model, data)
    lifted = dict(zip(links.frames, links.read(data, 0.1)))
    # A positive angle leans the arm backwards: about -y.
    expected = (0.0, -math.sin(0.25), 0.0, math.cos(0.25))
    assert lifted["shoulder_pan", "shoulder_lift"].rotation == pytest.approx(expected, abs=1e-6)
    assert lifted["wrist", urdf.GRIPPER_LINK].rotation == pytest.approx((math.sin(0.05), 0, 0, math.cos(0.05)))
    above, below = lifted["shoulder_lift", "elbow"], at_zero["shoulder_lift", "elbow"]
    assert (*above.translation, *above.rotation) == pytest.approx((*below.translation, *below.rotation))
