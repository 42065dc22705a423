"""The vendor's controllers, servos and battery, without a ROS graph."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.graph import ARM_JOINTS, CONTROLLERS
from lupin_sim import mirte
from lupin_sim.collisions import CollisionCounter
from lupin_sim.controllers import ACTIVE, INACTIVE, STATES, UNCONFIGURED, UNLOADED, ControllerManager
from lupin_sim.servos import NAMES, ServoBus, angle_range
from lupin_sim.trajectory import Trajectory, TrajectoryController, TrajectoryRefused, parse

names = st.sampled_from(CONTROLLERS)
operations = st.lists(
    st.one_of(
        st.tuples(st.just("load"), names),
        st.tuples(st.just("configure"), names),
        st.tuples(st.just("switch"), st.lists(names), st.lists(names), st.booleans()),
    ),
    max_size=25,
)


# -- controller manager -----------------------------------------------------------------------------------------------
@given(st.sampled_from(STATES), operations)
def test_controller_states_stay_valid_for_any_requests(start: str, requests: list[Any]) -> None:
    manager = ControllerManager(start)
    for name, *arguments in requests:
        before = dict(manager.states)
        reply = getattr(manager, name)(*arguments)
        assert set(manager.states) == set(CONTROLLERS)
        assert set(manager.states.values()) <= set(STATES)
        if manager.states["mirte_base_controller"] == ACTIVE:
            assert manager.states["pid_wheels_controller"] == ACTIVE
        for controller, state in manager.states.items():
            # Each request moves a controller by at most one state.
            assert abs(STATES.index(state) - STATES.index(before[controller])) <= 1
        if not reply.ok:
            assert reply.message
        if name == "switch" and arguments[2] and not reply.ok:
            assert manager.states == before


def test_controllers_are_activated_in_the_order_of_ros2_control() -> None:
    manager = ControllerManager(UNLOADED)
    assert manager.loaded == ()
    for name in CONTROLLERS:
        assert not manager.configure(name).ok
        assert manager.load(name).ok
        assert not manager.load(name).ok
        assert manager.configure(name).ok
    assert manager.switch(CONTROLLERS, (), strict=True).ok
    assert all(manager.is_active(name) for name in CONTROLLERS)


def test_base_controller_needs_the_wheel_controller() -> None:
    manager = ControllerManager(INACTIVE)
    refused = manager.switch(["mirte_base_controller"], (), strict=True)
    assert not refused.ok
    assert "pid_wheels_controller" in refused.message
    assert manager.switch(["mirte_base_controller", "pid_wheels_controller"], (), strict=True).ok
    assert not manager.switch((), ["pid_wheels_controller"], strict=True).ok


def test_best_effort_makes_the_possible_changes() -> None:
    manager = ControllerManager(UNCONFIGURED)
    manager.configure("joint_state_broadcaster")
    reply = manager.switch(["joint_state_broadcaster", "mirte_master_arm_controller"], (), strict=False)
    assert not reply.ok
    assert "mirte_master_arm_controller is unconfigured" in reply.message
    assert manager.is_active("joint_state_broadcaster")


def test_unknown_controller_is_refused() -> None:
    assert "not a controller" in ControllerManager().load("diff_drive_controller").message


# -- trajectories -----------------------------------------------------------------------------------------------------
def test_trajectory_is_sorted_by_joint() -> None:
    backwards = tuple(reversed(ARM_JOINTS))
    assert parse(backwards, [[4, 3, 2, 1]], [1.0]).points == ((1.0, 2.0, 3.0, 4.0),)


@pytest.mark.parametrize(
    ("joints", "positions", "times", "text"),
    [
        (ARM_JOINTS[:3], [[0, 0, 0]], [1.0], "exactly the joints"),
        ((*ARM_JOINTS, "gripper_joint"), [[0] * 5], [1.0], "exactly the joints"),
        ((), [], [], "exactly the joints"),
        (ARM_JOINTS, [], [], "no points"),
        (ARM_JOINTS, [[0, 0, 0]], [1.0], "has 3 positions"),
        (ARM_JOINTS, [[0, math.nan, 0, 0]], [1.0], "not finite"),
        (ARM_JOINTS, [[0] * 4, [1] * 4], [1.0, 1.0], "is not after"),
        (ARM_JOINTS, [[0] * 4], [-2.0], "is not after"),
    ],
)
def test_partial_and_malformed_trajectories_are_refused(
    joints: tuple[Any, ...], positions: list[list[float] | list[int]], times: list[float], text: str
) -> None:
    with pytest.raises(TrajectoryRefused, match=text):
        parse(joints, positions, times)


def test_controller_interpolates_from_its_last_command() -> None:
    controller = TrajectoryController((0.0, 0.0, 0.0, 0.0))
    controller.follow(Trajectory((1.0, 3.0), ((1.0, 0, 0, 0), (0.0, 2.0, 0, 0))), 10.0)
    assert controller.step(10.5) == pytest.approx((0.5, 0, 0, 0))
    assert controller.step(12.0) == pytest.approx((0.5, 1.0, 0, 0))
    controller.follow(Trajectory((1.0,), ((0.5, 0.0, 0, 0),)), 12.0)
    assert controller.step(12.5) == pytest.approx((0.5, 0.5, 0, 0))
    assert not controller.finished
    assert controller.step(13.0) == pytest.approx((0.5, 0.0, 0, 0))
    assert controller.finished


# -- servos -----------------------------------------------------------------------------------------------------------
@given(st.integers(0, len(NAMES) - 1), st.floats(-10, 10))
def test_setpoint_is_limited_to_the_servos_range(index: int, angle: float) -> None:
    bus = ServoBus([0.0] * len(NAMES))
    bus.set_angle(index, angle)
    low, high = angle_range(index)
    assert low <= bus.setpoints[index] <= high


def test_references_move_at_the_servos_speed() -> None:
    bus = ServoBus([0.0] * len(NAMES))
    bus.set_angle(0, 1.0)
    bus.targets(0.1)
    assert bus.references[0] == pytest.approx(0.1 * mirte.SERVO_SPEED_RADPS)


def test_servo_held_off_its_setpoint_for_a_second_is_stalled() -> None:
    bus = ServoBus([0.0] * len(NAMES))
    bus.set_angle(2, 0.5)
    for tick in range(200):
        bus.read([0.0] * 4 + [0.0])
        bus.targets(0.01)
        if tick < 100:
            assert not bus.stalled
    assert bus.stalled == ("elbow",)
    bus.set_torque(False)
    bus.targets(0.01)
    assert not bus.stalled


def test_controller_sends_a_pushed_servo_back() -> None:
    """The vendor sends the setpoint again to a servo that is more than 0.05 rad off, overriding direct servo calls."""
    bus = ServoBus([0.0] * len(NAMES))
    bus.write([0.0] * 5)
    bus.set_angle(0, 0.5)
    bus.angles[0] = 0.03
    bus.write([0.0] * 5)
    assert bus.setpoints[0] == 0.5
    bus.angles[0] = 0.06
    bus.write([0.0] * 5)
    assert bus.setpoints[0] == 0.0


def test_offset_shifts_encoder_and_command() -> None:
    bus = ServoBus([0.0] * len(NAMES))
    bus.offsets_counts[1] = 500
    bus.read([0.0] * 5)
    assert bus.angles[1] == pytest.approx(math.radians(-5.0))
    assert bus.raw_counts(1) == 11450 - 500
    assert bus.targets(0.01)[1] == pytest.approx(bus.references[1] + math.radians(5.0))


@given(st.floats(mirte.GRIPPER_LOWER_RAD, mirte.GRIPPER_UPPER_RAD))
def test_gripper_angle_and_aperture_are_inverse_functions(angle: float) -> None:
    assert mirte.gripper_from_aperture(mirte.aperture_from_gripper(angle)) == pytest.approx(angle, abs=1e-9)


def test_larger_gripper_angle_has_smaller_aperture() -> None:
    assert mirte.aperture_from_gripper(-0.2) == 0.0656
    assert mirte.aperture_from_gripper(0.25) == pytest.approx(0.0008)


# -- collisions -------------------------------------------------------------------------------------------------------
def test_contact_counts_once_until_a_second_without_contact() -> None:
    counter = CollisionCounter()
    for tick in range(300):
        counter.update("wall", tick / 100)
    assert counter.count == 1
    counter.update(None, 3.5)
    assert not counter.update("wall", 3.9)
    assert counter.update("box", 5.0)
    assert (counter.count, counter.last_object, counter.last_time_s) == (2, "box", 5.0)


def test_battery_voltage_falls_with_its_charge() -> None:
    volts = [mirte.battery_volts(f) for f in (1.0, 0.7, 0.5, 0.2, 0.0)]
    assert volts == pytest.approx([12.6, 11.85, 11.52, 11.19, 9.81])
