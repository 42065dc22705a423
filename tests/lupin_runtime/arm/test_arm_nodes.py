"""The arm's nodes on a real graph, against a fake vendor that records its calls."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.arm import PRESETS, Refused, async_wait
from lupin_runtime.arm.motion import HOLD_FRESH_S
from tests.support.arm_vendor import Vendor, arm_nodes, record
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


def test_first_command_holds_the_arm_where_it_is(graph_host: GraphHost, vendor: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    message = vendor.trajectories[0]
    assert tuple(message.joint_names) == graph.ARM_JOINTS
    assert list(message.points[0].positions) == vendor.at
    assert list(message.points[0].velocities) == [1.0] * 4


def test_preset_is_one_point_at_three_seconds(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    count = len(vendor.trajectories)
    answer = console.ask(graph.ARM_PRESET, name=" Home ")
    assert answer.success
    graph_host.until(lambda: len(vendor.trajectories) > count, what="the trajectory")
    assert vendor.last == PRESETS["home"] and len(vendor.trajectories[-1].points) == 1
    duration = vendor.trajectories[-1].points[0].time_from_start
    assert (duration.sec, duration.nanosec) == (3, 0)


def test_unknown_preset_call_fails_and_lists_the_known_ones(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    answer = console.ask(graph.ARM_PRESET, name="wave")
    assert not answer.success and "home, zero, tuck, pick, place, inspect" in answer.message


def test_recorder_does_not_count_as_an_arm_controller(graph_host: GraphHost, console: Any) -> None:
    from sensor_msgs.msg import JointState

    from lupin_runtime.arm.shared_arm import OBSERVERS
    from lupin_runtime.ros import LupinNode

    for name in OBSERVERS:
        observer = graph_host.add(LupinNode(name))
        observer.subscription(graph.ARM_TRAJECTORY, lambda _: None)
    joints = console.node.publisher(graph.JOINT_STATES)
    console.node.create_timer(0.02, lambda: joints.publish(JointState(name=list(graph.ARM_JOINTS), position=[0.0] * 4)))
    motion = arm_nodes(graph_host)[0].motion
    publisher = motion._listeners.__self__._publisher
    graph_host.until(lambda: publisher.get_subscription_count() > len(OBSERVERS), what="the observers")
    graph_host.until(lambda: motion.state(fresh=True), what="the pose")
    refused = console.ask(graph.ARM_PRESET, name="home")
    assert not refused.success and "lupin home" in refused.message


def test_single_joint_moves_in_degrees_and_radians(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    row = graph.arm_joint_angle("elbow_joint")
    assert console.ask(row, angle=30.0, rate=30.0, degrees=True).status
    graph_host.until(lambda: vendor.last == pytest.approx((0.1, 0.2, math.radians(30), -0.4), abs=1e-6))
    assert console.ask(row, angle=0.5, rate=0.0, degrees=False).status
    graph_host.until(lambda: vendor.last == pytest.approx((0.1, 0.2, 0.5, -0.4), abs=1e-6))
    assert not console.ask(row, angle=math.nan, rate=0.0, degrees=False).status


def test_single_joint_is_refused_without_joint_states(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    vendor.publishes = False
    arm_nodes(graph_host)
    assert not console.ask(graph.arm_joint_angle("wrist_joint"), angle=1.0, rate=0.0, degrees=True).status
    assert vendor.trajectories == []


def test_gripper_uses_its_action_at_the_mapped_angle(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    for degrees, rad in ((-30.0, -0.20), (30.0, 0.25), (90.0, 0.25)):
        count = len(vendor.gripper_goals)
        assert console.ask(graph.GRIPPER_ANGLE, angle=degrees, rate=0.0, degrees=True).status
        graph_host.until(lambda n=count: len(vendor.gripper_goals) > n, what="the goal")  # type: ignore[misc]
        assert vendor.gripper_goals[-1] == pytest.approx((rad, 2.0))
    assert not console.ask(graph.GRIPPER_ANGLE, angle=math.inf, rate=0.0, degrees=True).status


def test_torque_closes_the_gate_first_and_opens_it_last(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    assert console.ask(graph.ARM_SET_TORQUE, data=False).success
    assert vendor.calls == [("gate", False), ("torque", False)]
    refused = console.ask(graph.ARM_PRESET, name="home")
    assert not refused.success and "limp" in refused.message
    vendor.calls.clear()
    vendor.at = [0.5, 0.5, 0.5, 0.5]  # moved by hand
    count = len(vendor.trajectories)
    # before the new pose arrives, a hold would keep the old one
    graph_host.until(lambda: arm_feedback() == (0.5, 0.5, 0.5, 0.5), what="feedback of the new pose")
    assert console.ask(graph.ARM_SET_TORQUE, data=True).success
    assert vendor.calls == [("torque", True), ("gate", True)]
    assert len(vendor.trajectories) == count + 1 and vendor.last == (0.5, 0.5, 0.5, 0.5)
    assert console.ask(graph.ARM_PRESET, name="home").success


def arm_feedback() -> tuple[float, ...] | None:
    from lupin_runtime.arm.shared_arm import _SHARED_ARM

    state = present(_SHARED_ARM.motion).state()
    return None if state is None else state.arm


def arm_is_seen() -> bool:
    from lupin_runtime.arm.shared_arm import _SHARED_ARM

    return present(_SHARED_ARM.motion).state(fresh=True, max_age_s=HOLD_FRESH_S) is not None


def test_overlapping_torque_calls_do_not_interleave(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    futures = [console.send(graph.ARM_SET_TORQUE, data=on) for on in (False, True, False, True)]
    graph_host.until(lambda: all(future.done() for future in futures), what="all four answers")
    off, on = [("gate", False), ("torque", False)], [("torque", True), ("gate", True)]
    pairs = [vendor.calls[i : i + 2] for i in range(0, 8, 2)]
    assert sorted(pairs) == sorted([off, on, off, on])


def test_torque_switches_without_a_vendor_gate(graph_host: GraphHost, console: Any) -> None:
    vendor = Vendor(graph_host, gate=False)
    arm_nodes(graph_host, pinned_by=vendor)
    assert console.ask(graph.ARM_SET_TORQUE, data=False).success
    assert vendor.calls == [("torque", False)]
    vendor.close()


def test_refused_torque_reopens_the_gate(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    vendor.refuse = {("torque", False)}
    answer = console.ask(graph.ARM_SET_TORQUE, data=False)
    assert not answer.success and "out of order" in answer.message
    assert vendor.calls == [("gate", False), ("torque", False), ("gate", True)]
    assert console.ask(graph.ARM_PRESET, name="home").success


def test_gate_reopens_on_the_pose_of_an_arm_that_was_moving(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    vendor.refuse = {("torque", False)}
    assert console.ask(graph.ARM_PRESET, name="tuck").success
    graph_host.until(lambda: len(vendor.trajectories) == 2, what="the preset")
    assert not console.ask(graph.ARM_SET_TORQUE, data=False).success
    graph_host.until(lambda: len(vendor.trajectories) == 3, what="the pose in which the arm is held")
    assert vendor.last == tuple(vendor.at)


def test_gate_stays_closed_if_the_pose_is_unknown(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    vendor.refuse = {("torque", False)}
    vendor.publishes = False
    with graph_host.clock.real():
        graph_host.until(lambda: not arm_is_seen(), what="the end of the feedback")
        answer = console.ask(graph.ARM_SET_TORQUE, data=False)
    assert not answer.success and "the arm takes no commands" in answer.message
    assert vendor.calls == [("gate", False), ("torque", False)]
    assert not console.ask(graph.ARM_PRESET, name="home").success


def test_arm_counts_as_limp_if_the_answer_was_lost(
    graph_host: GraphHost, vendor: Any, console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(async_wait.answer, "__defaults__", (0.3,))
    arm_nodes(graph_host, pinned_by=vendor)
    vendor.silent = {("torque", False)}
    answer = console.ask(graph.ARM_SET_TORQUE, data=False)
    assert not answer.success and "the torque may be off" in answer.message
    assert vendor.calls == [("gate", False), ("torque", False)]  # the gate of a limp arm stays closed
    refused = console.ask(graph.ARM_PRESET, name="home")
    assert not refused.success and "limp" in refused.message
    graph_host.within(vendor.node, vendor.answer)
    assert console.ask(graph.ARM_SET_TORQUE, data=True).success
    assert vendor.calls[2:] == [("torque", True), ("gate", True)]
    assert console.ask(graph.ARM_PRESET, name="home").success


def test_torque_on_is_refused_without_joint_states(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    vendor.publishes = False
    arm_nodes(graph_host)
    answer = console.ask(graph.ARM_SET_TORQUE, data=True)
    assert not answer.success and "joint_states" in answer.message and vendor.calls == []


def test_init_sends_all_joints_to_zero(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    assert console.ask(graph.ARM_INIT).success
    graph_host.until(lambda: vendor.last == (0.0, 0.0, 0.0, 0.0), what="zero")
    assert vendor.trajectories[-1].points[0].time_from_start.sec == 5


def test_arm_nodes_of_a_process_share_one_publisher(graph_host: GraphHost, vendor: Any, tmp_path: Path) -> None:
    nodes = arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    assert nodes[0].count_publishers(graph.ARM_TRAJECTORY.name) == 1
    # the node that owns the publisher may leave; the others continue
    graph_host.remove(nodes[0])
    count = len(vendor.trajectories)

    def pinned() -> bool:
        try:
            nodes[1].motion.pin()
        except Refused:
            return False
        return len(vendor.trajectories) > count

    graph_host.until(pinned, what="a pin by the new host")


def test_current_pose_is_saved_listed_and_moved_to(graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    vendor.gripper_at = 0.1
    assert console.ask(graph.ARM_LIBRARY_SAVE_POSE, name="Here", from_current=True, has_gripper=False).success
    assert not console.ask(graph.ARM_LIBRARY_SAVE_POSE, name="here", from_current=True).success
    given = {"name": "there", "arm_rad": [0.0, 0.0, 9.0, 0.0], "gripper_rad": 0.25, "has_gripper": True}
    assert console.ask(graph.ARM_LIBRARY_SAVE_POSE, **given).success
    listing = json.loads(console.ask(graph.ARM_LIBRARY_LIST).json)
    assert [(p["name"], p["has_gripper"]) for p in listing["poses"]] == [("here", False), ("there", True)]
    assert console.ask(graph.ARM_LIBRARY_GOTO_POSE, name="there").success
    graph_host.until(lambda: vendor.gripper_goals, what="the gripper's goal")
    assert vendor.last == pytest.approx((0.0, 0.0, math.pi / 2, 0.0), abs=1e-5), "clamped when saved"
    missing = console.ask(graph.ARM_LIBRARY_GOTO_POSE, name="nowhere")
    assert not missing.success and "here, there" in missing.message
    assert console.ask(graph.ARM_LIBRARY_DELETE, kind="pose", name="here", new_name="hither").success
    assert console.ask(graph.ARM_LIBRARY_DELETE, kind="pose", name="there").success
    names = [p["name"] for p in json.loads(console.ask(graph.ARM_LIBRARY_LIST).json)["poses"]]
    assert names == ["hither"]


def test_motion_is_recorded_and_replayed_with_its_gripper(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    assert vendor.calls == [], "teleop never touches the torque"
    count, grips = len(vendor.trajectories), len(vendor.gripper_goals)
    answer = console.ask(graph.ARM_LIBRARY_PLAY, name="nod", speed=2.0)
    assert answer.success, answer.message
    assert vendor.calls == [("torque", True), ("gate", True)], "torque is forced on"
    graph_host.until(lambda: console.states[-1]["playing"], what="the playing state")
    refused = console.ask(graph.ARM_PRESET, name="home")
    assert not refused.success and "playing nod" in refused.message
    assert not console.ask(graph.ARM_LIBRARY_RECORD, action="start", name="x").success
    assert not console.ask(graph.ARM_LIBRARY_PLAY, name="nod").success
    graph_host.until(lambda: not console.states[-1]["playing"], what="the end of the replay")
    replay = vendor.trajectories[-1]
    assert len(vendor.trajectories) == count + 2, "the pin before the torque, then the replay"
    times = [p.time_from_start.sec + p.time_from_start.nanosec * 1e-9 for p in replay.points]
    assert times == sorted(set(times)) and replay.points[-1].positions[0] == pytest.approx(0.5)
    assert [round(p, 2) for p, _ in vendor.gripper_goals[grips:]] == [0.0, 0.2]
    assert console.ask(graph.ARM_PRESET, name="home").success


def test_kinesthetic_recording_is_limp_until_it_is_saved(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states and console.states[-1]["torque"], what="the library's state")
    record(graph_host, vendor, console, "led", "kinesthetic")
    assert vendor.calls == [("gate", False), ("torque", False), ("torque", True), ("gate", True)]
    assert any(not state["torque"] for state in console.states)
    graph_host.until(lambda: console.states[-1]["torque"], what="torque on in the state")


def test_kinesthetic_recording_needs_a_limp_arm(graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    vendor.refuse = {("torque", False)}
    answer = console.ask(graph.ARM_LIBRARY_RECORD, action="start", name="led", mode="kinesthetic")
    assert not answer.success and "out of order" in answer.message
    console.states.clear()
    graph_host.until(lambda: console.states, what="the library's state after it")
    assert not console.states[-1]["recording"] and console.states[-1]["torque"]
    assert console.ask(graph.ARM_LIBRARY_RECORD, action="start", name="x").success, "rolled back"


def test_stop_holds_the_arm_and_ends_the_activity(graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    assert console.ask(graph.ARM_LIBRARY_RECORD, action="start", name="led", mode="kinesthetic").success
    vendor.at = [0.7, 0.2, 0.3, -0.4]
    graph_host.until(lambda: present(arm_feedback())[0] == 0.7, what="feedback of the new pose")
    answer = console.ask(graph.ARM_LIBRARY_STOP)
    assert answer.success and "torque on" in answer.message
    assert vendor.calls[-2:] == [("torque", True), ("gate", True)]
    assert vendor.last[0] == 0.7
    assert not console.ask(graph.ARM_LIBRARY_RECORD, action="save").success, "nothing is being recorded any more"


def test_taken_name_does_not_lose_the_recording(graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    vendor.at = [0.1, 0.2, 0.3, -0.4]
    assert console.ask(graph.ARM_LIBRARY_RECORD, action="start", mode="teleop").success
    console.states.clear()
    graph_host.until(lambda: console.states and console.states[-1]["n_waypoints"] >= 1, what="a waypoint")
    assert not console.ask(graph.ARM_LIBRARY_RECORD, action="save", name="nod").success
    assert console.ask(graph.ARM_LIBRARY_RECORD, action="save", name="nod2").success
    assert not console.ask(graph.ARM_LIBRARY_RECORD, action="dance").success


def test_torque_off_ends_a_replay(graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    assert console.ask(graph.ARM_LIBRARY_PLAY, name="nod", speed=0.25).success
    graph_host.until(lambda: console.states[-1]["playing"], what="the playing state")
    assert console.ask(graph.ARM_SET_TORQUE, data=False).success
    graph_host.until(lambda: not console.states[-1]["playing"], what="the end of the replay")


@pytest.mark.parametrize("cause", ["torque", "held up"])
def test_replay_of_an_arm_that_was_held_is_aborted(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path, cause: str
) -> None:
    library = arm_nodes(graph_host, tmp_path, pinned_by=vendor)[-1]
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    assert console.ask(graph.ARM_LIBRARY_PLAY, name="nod", speed=0.25).success
    if cause == "torque":
        assert console.ask(graph.ARM_SET_TORQUE, data=True).success
    else:
        graph_host.within(library, lambda: setattr(library._activity, "sampled_ns", library._activity.sampled_ns - 10**9))
    graph_host.until(lambda: console.states[-1]["aborted"], what="the end of the replay")
    assert ("the arm was stopped" if cause == "torque" else "held up for 1.0 s") in console.states[-1]["aborted"]
    assert not console.states[-1]["playing"]

    def is_held() -> bool:
        library.motion.hold_if_due()  # as arm_monitor calls it
        return bool(list(vendor.trajectories[-1].points[-1].positions) == vendor.at)

    graph_host.until(is_held, what="the held pose")
    assert vendor.gripper_goals == []


def test_recording_stopped_before_it_began_is_refused(graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    vendor.silent = {("torque", False)}
    start = console.send(graph.ARM_LIBRARY_RECORD, action="start", name="led", mode="kinesthetic")
    graph_host.until(lambda: ("torque", False) in vendor.calls, what="the recording's wait for the torque")
    stop = console.send(graph.ARM_LIBRARY_STOP)
    graph_host.until(lambda: console.states and not console.states[-1]["recording"], what="the end of the recording")
    graph_host.within(vendor.node, vendor.answer)
    graph_host.until(lambda: start.done() and stop.done(), what="both answers")
    assert not start.result().success and start.result().message == "stopped before it began"
    assert vendor.calls[-2:] == [("torque", True), ("gate", True)]


def test_stopped_replay_keeps_the_next_ones_reservation(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    library = arm_nodes(graph_host, tmp_path, pinned_by=vendor)[-1]
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    vendor.silent = {("torque", True)}
    first = console.send(graph.ARM_LIBRARY_PLAY, name="nod", speed=0.25)
    graph_host.until(lambda: ("torque", True) in vendor.calls, what="the first replay's wait for the torque")
    assert console.ask(graph.ARM_LIBRARY_STOP).success
    second = console.send(graph.ARM_LIBRARY_PLAY, name="nod", speed=0.25)
    graph_host.until(lambda: library.motion.holder == "playing nod", what="the second replay's reservation")
    graph_host.within(vendor.node, vendor.answer)
    graph_host.until(lambda: first.done() and second.done(), what="both answers")
    assert (first.result().success, second.result().success) == (False, True)
    refused = console.ask(graph.ARM_PRESET, name="home")
    assert not refused.success and "playing nod" in refused.message
