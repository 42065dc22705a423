import math

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
def test_the_base_drives_what_it_is_told(twist, drive):
    simulation = Simulation(HALL)
    drive(simulation, twist, 2.0)
    assert simulation.true_twist == pytest.approx(twist, abs=2e-3)
    # A tenth of a second of lag is what is missing of the way.
    moved = simulation.true_pose
    assert math.hypot(moved.x - 3.0, moved.y - 2.0) == pytest.approx(2.0 * math.hypot(*twist[:2]), abs=0.06)


def test_a_turn_turns_about_the_middle(drive):
    simulation = Simulation(HALL)
    drive(simulation, (0.0, 0.0, 1.0), 1.5)
    assert simulation.true_pose.yaw == pytest.approx(1.5, abs=0.12)
    assert math.hypot(simulation.true_pose.x - 3.0, simulation.true_pose.y - 2.0) < 1e-3


def test_turning_while_driving_stays_on_the_circle(drive):
    """The slides of the planar base stand in the world's axes: taking a stale heading would widen the circle."""
    simulation = Simulation(HALL)
    drive(simulation, (0.3, 0.0, 0.6), 8.0)
    centre = (3.0, 2.5)
    radius = math.hypot(simulation.true_pose.x - centre[0], simulation.true_pose.y - centre[1])
    assert radius == pytest.approx(0.5, abs=0.03)


def test_wheels_stop_a_quarter_second_after_the_last_command(simulation, drive, rest):
    drive(simulation, (0.4, 0.0, 0.0), 1.0)
    # The last command of `drive` is 50 ms old.
    rest(simulation, 0.19)
    assert speed(simulation) > 0.39
    rest(simulation, 0.30)
    assert speed(simulation) < 0.01
    at = simulation.true_pose
    rest(simulation, 2.0)
    assert simulation.true_pose.distance_to(at) < 0.005


@pytest.mark.parametrize("poison", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("component", [0, 1, 2])
def test_a_command_that_is_not_finite_stops_the_wheels(simulation, poison, component, drive):
    drive(simulation, (0.3, 0.0, 0.0), 0.5)
    bad = [0.3, 0.0, 0.0]
    bad[component] = poison
    drive(simulation, tuple(bad), 0.5)
    assert speed(simulation) < 0.01
    assert np.all(np.isfinite(simulation.data.qpos))
    drive(simulation, (0.3, 0.0, 0.0), 0.5)
    assert speed(simulation) > 0.29


def test_a_blocked_robot_stands_while_its_odometry_runs_on(drive):
    simulation = Simulation(HALL)
    simulation.place(Pose2(7.7, 3.0, 0.0))
    drive(simulation, (0.3, 0.0, 0.0), 4.0)
    assert simulation.true_pose.x < 8.0 - 0.13
    assert simulation.odometry.pose.x == pytest.approx(1.2, abs=0.08)
    assert simulation.collisions.count == 1
    assert simulation.collisions.last_what == "wall_east"


def test_driving_free_counts_no_collision(simulation, drive):
    drive(simulation, (0.3, 0.0, 0.0), 3.0)
    assert simulation.collisions.count == 0
    assert simulation.distance_m == pytest.approx(0.88, abs=0.05)


@pytest.mark.parametrize("stopped", ["mirte_base_controller", "pid_wheels_controller"])
def test_without_its_controllers_the_base_does_not_drive(simulation, stopped, drive):
    deactivate = ["mirte_base_controller", stopped]
    assert simulation.switch_controllers([], deactivate, strict=True)[0]
    drive(simulation, (0.3, 0.0, 0.0), 1.0)
    assert speed(simulation) < 1e-6


def test_vendor_fidelity_drives_too(drive):
    simulation = Simulation(HALL, fidelity="vendor")
    drive(simulation, (0.4, 0.0, 0.0), 3.0)
    assert 0.2 < simulation.true_twist[0] < 0.45


# -- lidar ------------------------------------------------------------------------------------------------------------
def wall_distance(x: float, y: float, heading: float) -> float:
    """From a point inside HALL to its wall."""
    c, s = math.cos(heading), math.sin(heading)
    ways = [(8.0 - x) / c if c > 1e-9 else math.inf, -x / c if c < -1e-9 else math.inf]
    ways += [(6.0 - y) / s if s > 1e-9 else math.inf, -y / s if s < -1e-9 else math.inf]
    return min(ways)


@pytest.mark.parametrize("pose", [Pose2(3.0, 2.0, 0.0), Pose2(5.5, 4.2, 2.1)])
def test_lidar_measures_the_walls_where_they_are(pose):
    """Beam 0 looks to the robot's right, beam 90 ahead: the vendor mounts the sensor a quarter turn to the left."""
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


def test_lidar_does_not_see_the_robot(simulation):
    assert float(np.min(simulation.true_ranges())) > 0.3


def test_beyond_its_range_the_lidar_sees_nothing():
    simulation = Simulation(World("long", (0.0, 0.0, 40.0, 4.0), (), (), Pose2(20.0, 2.0)).with_outer_walls())
    scan = simulation.scan()
    assert np.isinf(scan[[90, 270]]).all()  # ahead and astern
    assert np.isfinite(scan[[0, 180]]).all()
    assert not np.any(np.isnan(scan))


# -- other sensors ----------------------------------------------------------------------------------------------------
def test_imu_feels_gravity_and_turning(simulation, drive):
    drive(simulation, (0.0, 0.0, 0.8), 1.0)
    samples = [simulation.imu() for _ in range(50)]
    assert np.mean([s.gyro[2] for s in samples]) == pytest.approx(0.8, abs=0.02)
    assert np.mean([s.accelerometer[2] for s in samples]) == pytest.approx(9.81, abs=0.1)


def test_wheels_ride_in_the_joint_states(simulation, drive):
    drive(simulation, (0.2, 0.0, 0.0), 1.0)
    joints = dict(zip(simulation.joints().names, simulation.joints().velocities))
    assert joints["front_left_wheel_joint"] == pytest.approx(0.2 / mirte.WHEEL_RADIUS_M, rel=0.01)
    assert set(simulation.joints().names) >= {"shoulder_pan_joint", "wrist_joint", "gripper_joint"}


def test_the_battery_runs_down_slowly(simulation, rest):
    before = simulation.battery
    rest(simulation, 5.0)
    assert 0.0 < before - simulation.battery < 0.01


@pytest.mark.parametrize(("order", "shown"), [("RGB", (1, 2, 3)), ("BRG", (2, 3, 1))])
def test_the_strips_wire_order_decides_which_colour_a_byte_drives(order, shown):
    simulation = Simulation(HALL, led_order=order)
    simulation.set_leds(1, 2, 3)
    assert simulation.led_colour == shown


# -- arm --------------------------------------------------------------------------------------------------------------
def test_the_arm_rests_where_it_starts(simulation, rest):
    rest(simulation, 1.0)
    assert simulation.servos.angles[:4] == pytest.approx(mirte.ARM_START_RAD, abs=0.02)
    assert simulation.servos.stalled == ()


def test_the_arm_follows_a_trajectory(simulation, rest):
    simulation.arm.follow(Trajectory((1.0, 2.0), ((0.3, 0.2, -0.2, -1.2), (0.5, 0.6, -0.8, -1.47))), simulation.time_s)
    rest(simulation, 3.0)
    assert simulation.servos.angles[:4] == pytest.approx((0.5, 0.6, -0.8, -1.47), abs=0.03)


def test_the_gripper_closes(simulation, rest):
    simulation.gripper_command = mirte.GRIPPER_UPPER_RAD
    rest(simulation, 2.0)
    assert simulation.servos.angles[4] == pytest.approx(mirte.GRIPPER_UPPER_RAD, abs=0.03)


def test_a_limp_arm_falls_and_stiffens_where_it_is(simulation, rest):
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


def test_opening_the_gate_of_a_moved_arm_makes_it_jump_back(simulation, rest):
    """The vendor's controller goes on wanting what it wanted; who re-enables an arm has to re-pin it first."""
    wanted = simulation.servos.angles[0]
    simulation.servos.gate_open = False
    simulation.servos.set_angle(0, 0.8)
    rest(simulation, 1.5)
    assert simulation.servos.angles[0] == pytest.approx(0.8, abs=0.05)
    simulation.servos.gate_open = True
    rest(simulation, 1.5)
    assert simulation.servos.angles[0] == pytest.approx(wanted, abs=0.05)


def test_an_arm_pressed_against_a_planter_stalls(rest):
    world = load_world("demo")
    simulation = Simulation(world)
    tag = world.tag(1)
    x, y = tag.pose.apply(0.20, 0.0)
    simulation.place(Pose2(x, y, tag.yaw + math.pi))
    # Straight ahead and down: the gripper meets the soil long before it gets there.
    simulation.arm.follow(Trajectory((1.0,), ((0.0, -1.2, -0.8, 0.0),)), simulation.time_s)
    rest(simulation, 4.0)
    assert simulation.servos.stalled


# -- time and repeatability -------------------------------------------------------------------------------------------
def test_simulated_time_begins_after_zero_and_advances_by_ticks(simulation):
    assert simulation.time_ns == START_NS > 0
    simulation.step()
    assert simulation.time_ns == START_NS + TICK_NS


def run_once(seed: int) -> list[bytes]:
    simulation = Simulation(load_world("demo"), seed=seed)
    prints = []
    simulation.arm.follow(Trajectory((1.0,), ((0.2, 0.6, -0.8, -1.47),)), simulation.time_s)
    for tick in range(300):
        if tick % 5 == 0:
            simulation.command_twist(0.3 * math.sin(tick / 40), 0.1, 0.4)
        simulation.step()
        if tick % 10 == 0:
            prints += [
                simulation.data.qpos.tobytes(),
                simulation.data.qvel.tobytes(),
                simulation.scan().tobytes(),
                repr((simulation.odometry.pose, simulation.imu())).encode(),
            ]
    return prints


def test_the_same_seed_and_commands_repeat_bit_for_bit():
    assert run_once(3) == run_once(3)


def test_another_seed_changes_what_sensors_say_and_not_where_the_robot_goes():
    one, other = run_once(3), run_once(4)
    assert one[0::4] == other[0::4]
    assert one[2::4] != other[2::4]
    assert one[3::4] != other[3::4]


@pytest.mark.parametrize(
    ("argument", "value", "text"),
    [("fidelity", "perfect", "ideal"), ("led_order", "RGX", "RGB"), ("controllers", "broken", "unconfigured")],
)
def test_settings_that_do_not_exist_are_refused_with_those_that_do(argument, value, text):
    with pytest.raises(ValueError, match=text):
        Simulation(HALL, **{argument: value})
