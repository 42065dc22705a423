"""The simulated base, lidar, IMU and joints behave as the robot's."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_sim import mirte
from lupin_sim.engine import START_NS, TICK_NS, Simulation
from lupin_sim.trajectory import Trajectory
from lupin_sim.world import World
from lupin_sim.worlds import load_world

HALL = World("hall", (0.0, 0.0, 8.0, 6.0), (), (), Pose2(3.0, 2.0, 0.0)).with_outer_walls()


def speed(simulation: Simulation) -> float:
    return math.hypot(*simulation.true_twist[:2])


# -- base -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("twist", [(0.3, 0.0, 0.0), (0.0, -0.3, 0.0), (0.2, 0.15, 0.0)])
def test_base_follows_the_commanded_twist(twist: tuple[float, float, float], drive: Callable[..., Any]) -> None:
    simulation = Simulation(HALL)
    drive(simulation, twist, 2.0)
    assert simulation.true_twist == pytest.approx(twist, abs=2e-3)
    # The missing distance corresponds to a lag of a tenth of a second.
    moved = simulation.true_pose
    assert math.hypot(moved.x - 3.0, moved.y - 2.0) == pytest.approx(2.0 * math.hypot(*twist[:2]), abs=0.06)


def test_base_rotates_about_its_center(drive: Callable[..., Any]) -> None:
    simulation = Simulation(HALL)
    drive(simulation, (0.0, 0.0, 1.0), 1.5)
    assert simulation.true_pose.yaw == pytest.approx(1.5, abs=0.12)
    assert math.hypot(simulation.true_pose.x - 3.0, simulation.true_pose.y - 2.0) < 1e-3


def test_driving_with_rotation_stays_on_the_circle(drive: Callable[..., Any]) -> None:
    """The slide joints are aligned with the world's axes, so that an outdated heading would widen the circle."""
    simulation = Simulation(HALL)
    drive(simulation, (0.3, 0.0, 0.6), 8.0)
    center = (3.0, 2.5)
    radius = math.hypot(simulation.true_pose.x - center[0], simulation.true_pose.y - center[1])
    assert radius == pytest.approx(0.5, abs=0.03)


def test_wheels_stop_a_quarter_second_after_the_last_command(
    simulation: Simulation, drive: Callable[..., Any], rest: Callable[..., Any]
) -> None:
    drive(simulation, (0.4, 0.0, 0.0), 1.0)
    # The last command of `drive` is 50 ms old.
    rest(simulation, 0.19)
    assert speed(simulation) > 0.39
    rest(simulation, 0.30)
    assert speed(simulation) < 0.01
    stopped = simulation.true_pose
    rest(simulation, 2.0)
    assert simulation.true_pose.distance_to(stopped) < 0.005


@pytest.mark.parametrize("poison", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("component", [0, 1, 2])
def test_command_that_is_not_finite_stops_the_wheels(
    simulation: Simulation, poison: float, component: int, drive: Callable[..., Any]
) -> None:
    drive(simulation, (0.3, 0.0, 0.0), 0.5)
    bad = [0.3, 0.0, 0.0]
    bad[component] = poison
    drive(simulation, tuple(bad), 0.5)
    assert speed(simulation) < 0.01
    assert np.all(np.isfinite(simulation.data.qpos))
    drive(simulation, (0.3, 0.0, 0.0), 0.5)
    assert speed(simulation) > 0.29


def test_odometry_continues_while_the_robot_is_blocked(drive: Callable[..., Any]) -> None:
    simulation = Simulation(HALL)
    simulation.place(Pose2(7.7, 3.0, 0.0))
    drive(simulation, (0.3, 0.0, 0.0), 4.0)
    assert simulation.true_pose.x < 8.0 - 0.13
    assert simulation.odometry.pose.x == pytest.approx(1.2, abs=0.08)
    assert simulation.collisions.count == 1
    assert simulation.collisions.last_object == "wall_east"


def test_free_driving_counts_no_collision(simulation: Simulation, drive: Callable[..., Any]) -> None:
    drive(simulation, (0.3, 0.0, 0.0), 3.0)
    assert simulation.collisions.count == 0
    assert simulation.distance_m == pytest.approx(0.88, abs=0.05)


@pytest.mark.parametrize("stopped", ["mirte_base_controller", "pid_wheels_controller"])
def test_base_without_its_controllers_does_not_drive(simulation: Simulation, stopped: str, drive: Callable[..., Any]) -> None:
    deactivate = ["mirte_base_controller", stopped]
    assert simulation.switch_controllers([], deactivate, strict=True)[0]
    drive(simulation, (0.3, 0.0, 0.0), 1.0)
    assert speed(simulation) < 1e-6


def test_base_with_vendor_fidelity_drives(drive: Callable[..., Any]) -> None:
    simulation = Simulation(HALL, fidelity="vendor")
    drive(simulation, (0.4, 0.0, 0.0), 3.0)
    assert 0.2 < simulation.true_twist[0] < 0.45


# -- lidar ------------------------------------------------------------------------------------------------------------
def wall_distance(x: float, y: float, heading: float) -> float:
    """Return the distance from a point in HALL to its wall, in the direction `heading`."""
    c, s = math.cos(heading), math.sin(heading)
    distances = [(8.0 - x) / c if c > 1e-9 else math.inf, -x / c if c < -1e-9 else math.inf]
    distances += [(6.0 - y) / s if s > 1e-9 else math.inf, -y / s if s < -1e-9 else math.inf]
    return min(distances)


@pytest.mark.parametrize("pose", [Pose2(3.0, 2.0, 0.0), Pose2(5.5, 4.2, 2.1)])
def test_lidar_measures_the_distances_of_the_walls(pose: Pose2) -> None:
    """Beam 0 points to the robot's right, beam 90 forward: the vendor mounts the sensor a quarter turn to the left."""
    simulation = Simulation(HALL)
    simulation.place(pose)
    lidar = pose @ Pose2(mirte.LIDAR_POSITION[0], 0.0, mirte.LIDAR_YAW_RAD)
    angles = -math.pi + 2 * math.pi / 360 * np.arange(360)
    expected = np.array([wall_distance(lidar.x, lidar.y, lidar.yaw + angle) for angle in angles])
    assert simulation.true_ranges() == pytest.approx(expected, abs=1e-6)
    scan = simulation.scan()
    seen = np.isfinite(scan)
    assert seen.mean() > 0.98
    error = scan[seen] - expected[seen]
    assert abs(float(error.mean())) < 0.003
    assert 0.005 < float(error.std()) < 0.03


def test_lidar_does_not_see_the_robot(simulation: Simulation) -> None:
    assert float(np.min(simulation.true_ranges())) > 0.3


def test_lidar_returns_inf_beyond_its_range() -> None:
    simulation = Simulation(World("long", (0.0, 0.0, 40.0, 4.0), (), (), Pose2(20.0, 2.0)).with_outer_walls())
    scan = simulation.scan()
    assert np.isinf(scan[[90, 270]]).all()  # forward and backward
    assert np.isfinite(scan[[0, 180]]).all()
    assert not np.any(np.isnan(scan))


# -- other sensors ----------------------------------------------------------------------------------------------------
def test_imu_measures_gravity_and_rotation(simulation: Simulation, drive: Callable[..., Any]) -> None:
    drive(simulation, (0.0, 0.0, 0.8), 1.0)
    samples = [simulation.imu() for _ in range(50)]
    assert np.mean([s.gyro[2] for s in samples]) == pytest.approx(0.8, abs=0.02)
    assert np.mean([s.accelerometer[2] for s in samples]) == pytest.approx(9.81, abs=0.1)


def test_joint_states_include_the_wheels(simulation: Simulation, drive: Callable[..., Any]) -> None:
    drive(simulation, (0.2, 0.0, 0.0), 1.0)
    joints = dict(zip(simulation.joints().names, simulation.joints().velocities))
    assert joints["front_left_wheel_joint"] == pytest.approx(0.2 / mirte.WHEEL_RADIUS_M, rel=0.01)
    assert set(simulation.joints().names) >= {"shoulder_pan_joint", "wrist_joint", "gripper_joint"}


def test_battery_discharges_slowly(simulation: Simulation, rest: Callable[..., Any]) -> None:
    before = simulation.battery
    rest(simulation, 5.0)
    assert 0.0 < before - simulation.battery < 0.01


@pytest.mark.parametrize(("order", "color"), [("RGB", (1, 2, 3)), ("BRG", (2, 3, 1))])
def test_led_order_selects_the_color_of_each_byte(order: str, color: tuple[int, int, int]) -> None:
    simulation = Simulation(HALL, led_order=order)
    simulation.set_leds(1, 2, 3)
    assert simulation.led_color == color


# -- arm --------------------------------------------------------------------------------------------------------------
def test_arm_stays_at_its_start_pose(simulation: Simulation, rest: Callable[..., Any]) -> None:
    rest(simulation, 1.0)
    assert simulation.servos.angles[:4] == pytest.approx(mirte.ARM_START_RAD, abs=0.02)
    assert simulation.servos.stalled == ()


def test_arm_follows_a_trajectory(simulation: Simulation, rest: Callable[..., Any]) -> None:
    simulation.arm.follow(Trajectory((1.0, 2.0), ((0.3, 0.2, -0.2, -1.2), (0.5, 0.6, -0.8, -1.47))), simulation.time_s)
    rest(simulation, 3.0)
    assert simulation.servos.angles[:4] == pytest.approx((0.5, 0.6, -0.8, -1.47), abs=0.03)


def test_gripper_closes(simulation: Simulation, rest: Callable[..., Any]) -> None:
    simulation.gripper_command = mirte.GRIPPER_UPPER_RAD
    rest(simulation, 2.0)
    assert simulation.servos.angles[4] == pytest.approx(mirte.GRIPPER_UPPER_RAD, abs=0.03)


def test_arm_without_torque_falls_and_then_holds_its_position(simulation: Simulation, rest: Callable[..., Any]) -> None:
    simulation.servos.set_angle(1, -0.6)
    simulation.servos.gate_open = False
    rest(simulation, 1.0)
    simulation.servos.set_torque(False)
    rest(simulation, 2.0)
    fallen = simulation.servos.angles[1]
    assert fallen < -1.0
    simulation.servos.set_torque(True)
    rest(simulation, 1.0)
    assert simulation.servos.angles[1] == pytest.approx(fallen, abs=0.05)


def test_moved_arm_jumps_back_when_the_gate_opens(simulation: Simulation, rest: Callable[..., Any]) -> None:
    """The vendor's controller keeps its last command, so its setpoint must be updated before the gate is opened."""
    commanded = simulation.servos.angles[0]
    simulation.servos.gate_open = False
    simulation.servos.set_angle(0, 0.8)
    rest(simulation, 1.5)
    assert simulation.servos.angles[0] == pytest.approx(0.8, abs=0.05)
    simulation.servos.gate_open = True
    rest(simulation, 1.5)
    assert simulation.servos.angles[0] == pytest.approx(commanded, abs=0.05)


def test_arm_pressed_against_a_planter_stalls(rest: Callable[..., Any]) -> None:
    world = load_world("demo")
    simulation = Simulation(world)
    tag = world.tag(1)
    x, y = tag.pose.apply(0.20, 0.0)
    simulation.place(Pose2(x, y, tag.yaw + math.pi))
    # Forward and down: the gripper touches the soil before it reaches this pose.
    simulation.arm.follow(Trajectory((1.0,), ((0.0, -1.2, -0.8, 0.0),)), simulation.time_s)
    rest(simulation, 4.0)
    assert simulation.servos.stalled


# -- time and repeatability -------------------------------------------------------------------------------------------
def test_simulated_time_starts_above_zero_and_advances_by_ticks(simulation: Simulation) -> None:
    assert simulation.time_ns == START_NS > 0
    simulation.step()
    assert simulation.time_ns == START_NS + TICK_NS


def run_once(seed: int) -> list[bytes]:
    """Return positions, velocities, scan and other sensors of a run, at every 10th tick."""
    simulation = Simulation(load_world("demo"), seed=seed)
    observations = []
    simulation.arm.follow(Trajectory((1.0,), ((0.2, 0.6, -0.8, -1.47),)), simulation.time_s)
    for tick in range(300):
        if tick % 5 == 0:
            simulation.command_twist(0.3 * math.sin(tick / 40), 0.1, 0.4)
        simulation.step()
        if tick % 10 == 0:
            observations += [
                simulation.data.qpos.tobytes(),
                simulation.data.qvel.tobytes(),
                simulation.scan().tobytes(),
                repr((simulation.odometry.pose, simulation.imu())).encode(),
            ]
    return observations


def test_same_seed_and_commands_give_identical_bits() -> None:
    assert run_once(3) == run_once(3)


def test_seed_changes_sensor_noise_and_not_the_motion() -> None:
    one, other = run_once(3), run_once(4)
    assert one[0::4] == other[0::4]
    assert one[2::4] != other[2::4]
    assert one[3::4] != other[3::4]


@pytest.mark.parametrize(
    ("argument", "value", "text"),
    [("fidelity", "perfect", "ideal"), ("led_order", "RGX", "RGB"), ("controllers", "broken", "unconfigured")],
)
def test_unknown_setting_is_refused_with_the_known_ones(argument: str, value: str, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Simulation(HALL, **{argument: value})  # type: ignore[arg-type]
