"""Flowers in the images of the gripper camera, with the color bands of the detector that runs against the simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from lupin_sim.flythrough import HOME, INSPECT
from lupin_sim.robot_model import GRIPPER_CAMERA
from lupin_sim.world import SPECIES

if TYPE_CHECKING:
    from tests.lupin_sim.conftest import Camera

MIN_AREA_PX = 150
# 0.5 and 0.35 of the area at which a detection has confidence 1; the aggregator accepts detections from 0.35 on.
CONFIDENT_PX, ACCEPTED_PX = 1000, 700


def blobs(image: np.ndarray) -> dict[str, list[int]]:
    """Areas of the blobs of each class, largest first."""
    h, s, v = (channel.astype(int) for channel in cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2HSV)))
    masks = {
        "tulip_red": ((h >= 150) | (h <= 8)) & (s >= 150) & (v >= 70),
        "tulip_white": (s <= 38) & (v >= 140),
        "tulip_pink": ((h >= 140) | (h <= 14)) & (s >= 40) & (s <= 135) & (v >= 140),
        "bug": v <= 50,
    }
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    found = {}
    for name, mask in masks.items():
        opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel)
        areas = cv2.connectedComponentsWithStats(opened)[2][1:, 4]
        found[name] = sorted((int(a) for a in areas if a >= MIN_AREA_PX), reverse=True)
    return found


def test_flowers_are_visible_in_their_color_from_the_approach(demo_camera: Camera, in_front_of: Callable[..., Any]) -> None:
    for tag in demo_camera.world.tags:
        planted = [flower for flower in demo_camera.world.flowers if flower.tag_id == tag.id]
        seen = blobs(demo_camera.capture(GRIPPER_CAMERA, in_front_of(tag), INSPECT))
        species = planted[0].species
        assert len([area for area in seen[species] if area > CONFIDENT_PX]) == len(planted), (tag, seen)
        for other in SPECIES:
            if other != species:
                assert sum(area > CONFIDENT_PX for area in seen[other]) == 0, (tag, seen)
        assert len([area for area in seen["bug"] if area > ACCEPTED_PX]) == sum(f.bug for f in planted), (tag, seen)


def test_flowers_stay_visible_from_an_inaccurate_approach(demo_camera: Camera, in_front_of: Callable[..., Any]) -> None:
    for tag in demo_camera.world.tags[:6]:
        planted = [flower for flower in demo_camera.world.flowers if flower.tag_id == tag.id]
        for off in ({"standoff_m": 0.45}, {"standoff_m": 0.58}, {"left_m": 0.06}, {"turn_rad": -0.08}):
            seen = blobs(demo_camera.capture(GRIPPER_CAMERA, in_front_of(tag, **off), INSPECT))
            big = [area for area in seen[planted[0].species] if area > ACCEPTED_PX]
            assert len(big) == len(planted), (tag, off, seen)


@pytest.mark.parametrize("arm", [HOME, INSPECT])
def test_greenhouse_has_no_flower_colors(demo_camera: Camera, arm: tuple[float, ...]) -> None:
    """Floor, walls, wood, soil, sky, tag plates and the robot's own fingers are in no color band.

    Seen from the start and from the ends of the aisles, far from flowers; distant ones are smaller than the accepted area.
    """
    from lupin_runtime.geometry import Pose2

    for pose in (Pose2(1.0, 0.9, -0.6), Pose2(0.7, 6.3, 2.8), Pose2(8.4, 1.3, -0.9), Pose2(1.0, 0.9, 3.1)):
        seen = blobs(demo_camera.capture(GRIPPER_CAMERA, pose, arm))
        assert all(area < ACCEPTED_PX for areas in seen.values() for area in areas), (pose, seen)


def test_near_tag_is_no_flower_and_no_bug(demo_camera: Camera, in_front_of: Callable[..., Any]) -> None:
    for tag in demo_camera.world.tags[:4]:
        seen = blobs(demo_camera.capture("body_camera", in_front_of(tag, 0.5)))
        assert not any(seen.values()), (tag, seen)
