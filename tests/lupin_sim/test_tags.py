"""The simulated tags are upright, in place and readable."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pyapriltags
import pytest

from lupin_sim import mirte
from lupin_sim.tag_plates import plate_image
from lupin_sim.worlds import load_world

if TYPE_CHECKING:
    from pyapriltags.apriltags import Detection, Detector

    from tests.lupin_sim.conftest import Camera

CAMERA = (mirte.FOCAL_PX, mirte.FOCAL_PX, *mirte.PRINCIPAL_POINT_PX)


@pytest.fixture(scope="module")
def detector() -> Detector:
    return pyapriltags.Detector(families="tag36h11", quad_decimate=1.0)


def detect(detector: Detector, image: np.ndarray, tag_id: int) -> Detection:
    found = detector.detect(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), True, CAMERA, 0.1)
    return next((d for d in found if d.tag_id == tag_id), None)


def test_detector_reads_plates_upright(detector: Detector) -> None:
    for tag_id in (0, 1, 2, 7, 9, 21, 30):
        image = cv2.copyMakeBorder(plate_image(tag_id), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=(90, 120, 90))
        found = detect(detector, image, tag_id)
        assert found is not None
        # The detector's first corner is the bottom left one of an upright tag.
        (ax, ay), (cx, cy) = found.corners[0], found.corners[2]
        assert ax < cx
        assert ay > cy


def test_rendered_tags_are_upright_and_in_place(
    demo_camera: Camera, in_front_of: Callable[..., Any], detector: Detector
) -> None:
    """From half a meter, slightly off axis, each tag is found upright and within millimeters of its true position."""
    for tag in demo_camera.world.tags:
        pose = in_front_of(tag, 0.5, left_m=0.06, turn_rad=0.08)
        found = detect(detector, demo_camera.capture("body_camera", pose), tag.id)
        assert found is not None, tag
        assert found.corners[0][0] < found.corners[2][0]
        assert found.corners[0][1] > found.corners[2][1]
        # Optical frame to base_link to world.
        right, down, ahead = (float(v) for v in found.pose_t.ravel())
        x, y = pose.apply(mirte.BODY_CAMERA_POSITION[0] + ahead, mirte.BODY_CAMERA_POSITION[1] - right)
        assert (x, y) == pytest.approx((tag.x, tag.y), abs=0.004)
        assert mirte.BODY_CAMERA_POSITION[2] - down == pytest.approx(tag.z, abs=0.003)


@pytest.mark.parametrize("distance", [0.75, 1.0, 1.5])
def test_tags_are_detected_from_up_to_1_5_meters(
    demo_camera: Camera, in_front_of: Callable[..., Any], detector: Detector, distance: float
) -> None:
    world = demo_camera.world
    seen = 0
    for tag in world.tags:
        pose = in_front_of(tag, distance)
        if world.clearance(pose.x, pose.y) < 0.2:
            continue
        found = detect(detector, demo_camera.capture("body_camera", pose), tag.id)
        assert found is not None, tag
        assert float(found.pose_t[2, 0]) == pytest.approx(distance - mirte.BODY_CAMERA_POSITION[0], abs=0.01)
        seen += 1
    assert seen >= 4


def test_plates_do_not_overlap_or_extend_over_an_edge() -> None:
    for name in ("demo", "course", "random:4", "walled"):
        world = load_world(name)
        boxes = {box.name: box for box in world.boxes}
        for tag in world.tags:
            box = boxes[tag.box]
            sides = [side for side in box.faces() if math.cos(side[0].yaw - tag.yaw) > 0.999]
            face, width = sides[0]
            out, along = face.inverse().apply(tag.x, tag.y)
            assert abs(out) < 1e-6
            assert abs(along) <= (width - 0.125) / 2 + 1e-6
            assert tag.z + 0.0625 <= box.height
            for other in world.tags:
                if other is not tag and other.box == tag.box and abs(math.cos(other.yaw - tag.yaw) - 1) < 1e-6:
                    assert math.hypot(other.x - tag.x, other.y - tag.y) >= 0.125
