"""Command windows of joints and gripper, and the presets within them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import LIMITS, PRESETS, UnknownPreset, clamp, clamp_arm, gripper_deg, gripper_rad, preset, window
from lupin_runtime.graph import ARM_JOINTS

FINITE = st.floats(-1e3, 1e3)


@pytest.mark.parametrize(
    ("joint", "lower", "upper"),
    [
        ("shoulder_pan_joint", -1.500983, 1.570796),
        ("shoulder_lift_joint", -1.500983, 1.483530),
        ("elbow_joint", -1.570796, 1.570796),
        ("wrist_joint", -1.570796, 1.535890),
        ("third_elbow_joint", -math.pi / 2, math.pi / 2),
    ],
)
def test_every_joint_has_its_own_command_window(joint: str, lower: float, upper: float) -> None:
    assert window(joint) == pytest.approx((lower, upper), abs=1e-6)


@pytest.mark.parametrize("joint", LIMITS)
def test_command_windows_are_within_the_servo_limits(joint: str) -> None:
    limits = LIMITS[joint]
    assert limits.servo_lower <= limits.lower < limits.upper <= limits.servo_upper


@given(st.sampled_from(ARM_JOINTS), FINITE)
def test_clamping_keeps_angles_within_the_window(joint: str, angle: float) -> None:
    lower, upper = window(joint)
    out = clamp(joint, angle)
    assert lower <= out <= upper
    assert out == angle or not lower <= angle <= upper


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_non_finite_angle_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        clamp_arm((0.0, bad, 0.0, 0.0))
    with pytest.raises(ValueError, match="finite"):
        gripper_rad(bad)
    with pytest.raises(ValueError, match="finite"):
        gripper_deg(bad)


@pytest.mark.parametrize("count", [0, 3, 5])
def test_arm_needs_four_angles(count: int) -> None:
    with pytest.raises(ValueError, match="4 angles"):
        clamp_arm([0.0] * count)


@given(st.floats(-30, 30))
def test_gripper_scales_are_inverse_within_the_window(degrees: float) -> None:
    assert gripper_deg(gripper_rad(degrees)) == pytest.approx(degrees, abs=1e-9)


@given(FINITE, FINITE)
def test_gripper_scale_is_clamped_and_increasing(a: float, b: float) -> None:
    assert -0.20 <= gripper_rad(a) <= 0.25
    assert (gripper_rad(a) <= gripper_rad(b)) or a > b
    assert -30 <= gripper_deg(a) <= 30


def test_gripper_is_open_at_minus_30_and_closed_at_plus_30() -> None:
    assert gripper_rad(-30) == pytest.approx(-0.20)
    assert gripper_rad(30) == pytest.approx(0.25)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_within_the_command_windows(name: str) -> None:
    assert preset(name) == PRESETS[name]


def test_preset_names_are_trimmed_and_case_insensitive() -> None:
    assert preset("  HoMe ") == PRESETS["home"]


def test_unknown_preset_lists_the_known_ones() -> None:
    with pytest.raises(UnknownPreset, match="home, zero, tuck, pick, place, inspect"):
        preset("wave")
