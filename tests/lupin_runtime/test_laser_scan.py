"""The projection of scans, against the rotation of every beam in space. REP 103 and 117, and tf2, say what is right."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.laser_scan import MAX_TILT_RAD, TiltedLaser, range_limits, scan_geometry
from lupin_runtime.transforms import Quaternion, Transform, multiply

angles = st.floats(-math.pi, math.pi)


def rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the rotation of a URDF's rpy: about the fixed axes x, y, z in turn."""
    result: Quaternion = (0.0, 0.0, 0.0, 1.0)
    for axis, angle in enumerate((roll, pitch, yaw)):
        turned = [0.0, 0.0, 0.0, math.cos(angle / 2.0)]
        turned[axis] = math.sin(angle / 2.0)
        result = multiply((turned[0], turned[1], turned[2], turned[3]), result)
    return result


def scan(**more: float) -> SimpleNamespace:
    values = {"angle_min": -1.0, "angle_increment": 0.1, "range_min": 0.1, "range_max": 12.0} | more
    return SimpleNamespace(header=SimpleNamespace(frame_id="laser"), **values)


@given(
    flip=st.sampled_from([(0.0, 0.0), (math.pi, 0.0), (-math.pi, 0.0), (0.0, math.pi), (math.pi, math.pi)]),
    yaw=angles,
    first=angles,
    step=st.floats(-0.1, 0.1),
    beam=st.integers(0, 400),
    length=st.floats(0.01, 1.0),  # of the quaternion: URDF tools round theirs
)
def test_level_mount_projects_beams_as_its_rotation_does(
    flip: tuple[float, float], yaw: float, first: float, step: float, beam: int, length: float
) -> None:
    rotation = rpy(*flip, yaw)
    x, y, z, w = (length * part for part in rotation)
    seen = scan_geometry(scan(angle_min=first, angle_increment=step), Transform((0.3, -0.2, 0.5), rotation))
    assert scan_geometry(scan(), Transform((0.0, 0.0, 0.0), (x, y, z, w))).angle_step_rad == math.copysign(
        0.1, math.cos(flip[0]) * math.cos(flip[1])
    )
    angle = first + step * beam
    truth = Transform((0.3, -0.2, 0.5), rotation).apply((math.cos(angle), math.sin(angle), 0.0))
    planar = seen.angle_min_rad + seen.angle_step_rad * beam
    assert seen.mount.apply(math.cos(planar), math.sin(planar)) == pytest.approx(truth[:2], abs=1e-9)


@given(roll=st.floats(-math.pi, math.pi), pitch=st.floats(-math.pi / 2, math.pi / 2), yaw=angles)
def test_tilted_laser_is_refused_with_its_angle(roll: float, pitch: float, yaw: float) -> None:
    tilt = math.acos(min(1.0, abs(math.cos(roll) * math.cos(pitch))))
    mount = Transform((0.0, 0.0, 0.2), rpy(roll, pitch, yaw))
    if tilt > MAX_TILT_RAD + 1e-6:
        with pytest.raises(TiltedLaser, match=rf"'laser' is tilted by {math.degrees(tilt):.0f} degrees"):
            scan_geometry(scan(), mount)
    elif tilt < MAX_TILT_RAD - 1e-6:
        scan_geometry(scan(), mount)


@pytest.mark.parametrize("stated", [0.0, math.inf, math.nan, -1.0])
def test_scan_without_a_stated_limit_has_none(stated: float) -> None:
    assert range_limits(scan(range_max=stated)) == (0.1, math.inf)
    if stated != math.inf:
        assert range_limits(scan(range_min=stated)) == (0.0, 12.0)
