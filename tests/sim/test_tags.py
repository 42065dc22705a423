import math

import cv2
import numpy as np
import pyapriltags
import pytest

from lupin_sim import mirte, tags
from lupin_sim.worlds import load_world

CAMERA = (mirte.FOCAL_PX, mirte.FOCAL_PX, *mirte.PRINCIPAL_POINT_PX)


@pytest.fixture(scope="module")
def detector():
    return pyapriltags.Detector(families="tag36h11", quad_decimate=1.0)


def detect(detector, image, tag_id):
    found = detector.detect(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), True, CAMERA, 0.1)
    return next((d for d in found if d.tag_id == tag_id), None)


def test_tag_0_is_the_official_one_and_upright():
    """OpenCV draws the family turned by 180 degrees, and a later version will not: this pins what hangs in the world."""
    inner = tags.modules(0)[2:-2, 2:-2]
    rows = ["".join("1" if white else "0" for white in row) for row in inner]
    assert tuple(rows) == ("110101", "011101", "011000", "101000", "010110", "000100")


@pytest.mark.parametrize("tag_id", [0, 1, 13, 30, 586])
def test_a_plate_has_a_white_margin_and_a_black_border(tag_id):
    modules = tags.modules(tag_id)
    assert modules.shape == (10, 10)
    ring = np.ones((10, 10), bool)
    ring[1:-1, 1:-1] = False
    assert modules[ring].all()
    ring[1:-1, 1:-1], ring[2:-2, 2:-2] = True, False
    ring[[0, -1]] = False
    ring[:, [0, -1]] = False
    assert not modules[ring].any()


@pytest.mark.parametrize("tag_id", [-1, 587])
def test_ids_outside_the_family_are_refused(tag_id):
    with pytest.raises(ValueError, match="36h11"):
        tags.modules(tag_id)


def test_the_library_reads_every_plate_upright(detector):
    for tag_id in (0, 1, 2, 7, 9, 21, 30):
        image = cv2.copyMakeBorder(tags.picture(tag_id), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=(90, 120, 90))
        found = detect(detector, image, tag_id)
        assert found is not None
        # The library's first corner is the bottom left of an upright tag.
        (ax, ay), (cx, cy) = found.corners[0], found.corners[2]
        assert ax < cx
        assert ay > cy


def test_rendered_tags_stand_upright_where_the_world_has_them(demo_eyes, in_front_of, detector):
    """Half a metre in front of each tag, a little off and turned: found, upright, and within millimetres of the truth."""
    for tag in demo_eyes.world.tags:
        pose = in_front_of(tag, 0.5, left_m=0.06, turn_rad=0.08)
        found = detect(detector, demo_eyes.look("body_camera", pose), tag.id)
        assert found is not None, tag
        assert found.corners[0][0] < found.corners[2][0]
        assert found.corners[0][1] > found.corners[2][1]
        # Optical frame to base_link to world.
        right, down, ahead = (float(v) for v in found.pose_t.ravel())
        x, y = pose.apply(mirte.BODY_CAMERA_POSITION[0] + ahead, mirte.BODY_CAMERA_POSITION[1] - right)
        assert (x, y) == pytest.approx((tag.x, tag.y), abs=0.004)
        assert mirte.BODY_CAMERA_POSITION[2] - down == pytest.approx(tag.z, abs=0.003)


@pytest.mark.parametrize("distance", [0.75, 1.0, 1.5])
def test_tags_are_found_from_as_far_as_a_perception_would_want_them(demo_eyes, in_front_of, detector, distance):
    world = demo_eyes.world
    seen = 0
    for tag in world.tags:
        pose = in_front_of(tag, distance)
        if world.clearance(pose.x, pose.y) < 0.2:
            continue
        found = detect(detector, demo_eyes.look("body_camera", pose), tag.id)
        assert found is not None, tag
        assert float(found.pose_t[2, 0]) == pytest.approx(distance - mirte.BODY_CAMERA_POSITION[0], abs=0.01)
        seen += 1
    assert seen >= 4


def test_no_plate_covers_another_or_hangs_over_an_edge():
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
