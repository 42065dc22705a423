"""The arm's nodes on a real graph, against a fake vendor that records its calls."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.arm import PRESETS, Refused
from tests.support.optional import present

if TYPE_CHECKING:
    from control_msgs.action import GripperCommand_Result
    from std_srvs.srv import SetBool_Response

    from lupin_runtime.arm.motion import ArmMotion
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class Vendor:
    """The vendor's side: joint states, gate and torque, the gripper's action. Its arm follows every command at once."""

    def __init__(self, host: GraphHost, gate: bool = True) -> None:
        from control_msgs.action import GripperCommand
        from rclpy.action import ActionServer
        from sensor_msgs.msg import JointState

        from lupin_runtime.ros import LupinNode

        self.at = [0.1, 0.2, 0.3, -0.4]
        self.gripper_at = 0.0
        self.speaks = True
        self.calls: list[tuple[str, bool]] = []
        self.refuse: set[tuple[str, bool]] = set()
        self.trajectories: list[Any] = []
        self.gripper_goals: list[tuple[float, float]] = []
        self.node = LupinNode("vendor")
        publisher = self.node.publisher(graph.JOINT_STATES)

        def speak() -> None:
            if self.speaks:
                names = [*graph.ARM_JOINTS, graph.GRIPPER_JOINT, *graph.WHEEL_JOINTS]
                publisher.publish(JointState(name=names, position=[*self.at, self.gripper_at, 0.0, 0.0, 0.0, 0.0]))
                publisher.publish(JointState(name=list(graph.WHEEL_JOINTS), position=[0.0] * 4))

        self.node.create_timer(0.02, speak)
        self.node.subscription(graph.ARM_TRAJECTORY, self.trajectories.append)
        self.node.service(graph.VENDOR_TORQUE, self._switch("torque"))
        if gate:
            self.node.service(graph.VENDOR_ARM_GATE, self._switch("gate"))

        def grip(goal: Any) -> GripperCommand_Result:
            command = goal.request.command
            self.gripper_goals.append((command.position, command.max_effort))
            goal.succeed()
            return GripperCommand.Result(position=command.position, reached_goal=True)

        self._server = ActionServer(self.node, GripperCommand, graph.GRIPPER_COMMAND.name, grip)
        host.add(self.node)

    def _switch(self, name: str) -> Callable[..., Any]:
        def serve(request: Any, response: SetBool_Response) -> SetBool_Response:
            self.calls.append((name, request.data))
            response.success = (name, request.data) not in self.refuse
            response.message = "" if response.success else "out of order"
            return response

        return serve

    def close(self) -> None:
        self._server.destroy()

    @property
    def last(self) -> tuple[float, ...]:
        return tuple(round(v, 6) for v in self.trajectories[-1].points[-1].positions)


class Console:
    """Calls services and waits for the responses."""

    def __init__(self, host: GraphHost) -> None:
        from lupin_runtime.ros import LupinNode

        self._host, self.node = host, LupinNode("console")
        self.states: list[dict[str, Any]] = []
        self.node.subscription(graph.ARM_LIBRARY_STATE, lambda message: self.states.append(json.loads(message.data)))
        self._clients: dict[str, Any] = {}
        host.add(self.node)

    def send(self, row: graph.Service, **fields: Any) -> Any:
        from lupin_runtime.ros.node import interface

        client = self._clients.setdefault(row.name, None) or self.node.client(row)
        self._clients[row.name] = client
        self._host.until(client.service_is_ready, what=f"{row.name}")
        return client.call_async(interface(row.type).Request(**fields))

    def ask(self, row: graph.Service, **fields: Any) -> Any:
        future = self.send(row, **fields)
        self._host.until(future.done, what=f"the answer of {row.name}")
        return future.result()


@pytest.fixture
def vendor(graph_host: GraphHost) -> Iterator[Any]:
    vendor = Vendor(graph_host)
    yield vendor
    vendor.close()


@pytest.fixture
def console(graph_host: GraphHost) -> Any:
    return Console(graph_host)


def arm_nodes(host: GraphHost, tmp_path: Path | None = None, pinned_by: Any = None) -> Any:
    """Create the three arm nodes of one process; with a vendor, wait for the first hold command."""
    from lupin_runtime.arm.node import ArmLibraryServer, ArmPresetServer, GripperActionBridge

    library = {"library_path": str(tmp_path / "arm_library.json")} if tmp_path else {}
    nodes = [host.add(ArmPresetServer()), host.add(GripperActionBridge())]
    if tmp_path:
        nodes.append(host.add(ArmLibraryServer(library)))
    if pinned_by is not None:
        host.until(lambda: pinned_by.trajectories, what="the pin")
    return nodes


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


def test_single_joint_moves_in_degrees_and_radians(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    row = graph.arm_joint_angle("elbow_joint")
    assert console.ask(row, angle=30.0, rate=30.0, degrees=True).status
    graph_host.until(lambda: vendor.last == pytest.approx((0.1, 0.2, math.radians(30), -0.4), abs=1e-6))
    assert console.ask(row, angle=0.5, rate=0.0, degrees=False).status
    graph_host.until(lambda: vendor.last == pytest.approx((0.1, 0.2, 0.5, -0.4), abs=1e-6))
    assert not console.ask(row, angle=math.nan, rate=0.0, degrees=False).status


def test_single_joint_is_refused_without_joint_states(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    vendor.speaks = False
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


def test_torque_on_is_refused_without_joint_states(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    vendor.speaks = False
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


def record(graph_host: GraphHost, vendor: Any, console: Any, name: str, mode: str) -> None:
    """Record a motion of the pan joint and the gripper."""
    assert console.ask(graph.ARM_LIBRARY_RECORD, action="start", name=name, mode=mode, include_gripper=True).success
    for step in range(5):
        vendor.at = [0.1 + 0.1 * step, 0.2, 0.3, -0.4]
        vendor.gripper_at = 0.0 if step < 3 else 0.2
        graph_host.until(lambda n=step: console.states[-1]["n_waypoints"] > n, what="the next waypoint")  # type: ignore[misc]
    answer = console.ask(graph.ARM_LIBRARY_RECORD, action="save")
    assert answer.success and answer.n_waypoints >= 5 and answer.duration_s > 0.5


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
    graph_host.until(lambda: console.states, what="the library's state")
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
    graph_host.until(lambda: console.states and console.states[-1]["n_waypoints"] >= 1, what="a way point")
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


class EStop:
    """Publishes the e-stop's state like the bridge."""

    def __init__(self, host: GraphHost, console: Any) -> None:
        self._host, self._publisher = host, console.node.publisher(graph.ESTOP_STATE)
        host.until(lambda: self._publisher.get_subscription_count() >= 2, what="the arm's subscriptions")

    def set(self, engaged: bool) -> None:
        from std_msgs.msg import Bool

        from lupin_runtime.arm.shared_arm import _SHARED_ARM

        def repeated() -> bool:
            self._publisher.publish(Bool(data=engaged))
            threading.Event().wait(0.05)
            return _refused(present(_SHARED_ARM.motion)) == engaged

        self._host.until(repeated, what="the arm's e-stop state")


def _refused(motion: ArmMotion) -> bool:
    try:
        motion.require_released()
    except Refused:
        return True
    return False


def test_estop_refuses_every_arm_command_with_its_reason(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    assert console.ask(graph.ARM_LIBRARY_SAVE_POSE, name="here", from_current=True).success
    estop = EStop(graph_host, console)
    estop.set(True)
    graph_host.until(lambda: list(vendor.trajectories[-1].points[0].positions) == vendor.at, what="the hold")
    count, grips = len(vendor.trajectories), len(vendor.gripper_goals)
    for row, fields in (
        (graph.ARM_PRESET, {"name": "home"}),
        (graph.ARM_INIT, {}),
        (graph.ARM_LIBRARY_GOTO_POSE, {"name": "here"}),
        (graph.ARM_LIBRARY_PLAY, {"name": "nod", "speed": 1.0}),
        (graph.ARM_LIBRARY_RECORD, {"action": "start", "name": "led", "mode": "kinesthetic"}),
    ):
        answer = console.ask(row, **fields)
        assert not answer.success and answer.message.startswith("e-stop engaged"), row.name
    assert not console.ask(graph.arm_joint_angle("elbow_joint"), angle=30.0, rate=30.0, degrees=True).status
    assert not console.ask(graph.GRIPPER_ANGLE, angle=30.0, rate=0.0, degrees=True).status
    assert (len(vendor.trajectories), len(vendor.gripper_goals), vendor.calls) == (count, grips, [])
    estop.set(False)
    assert console.ask(graph.ARM_PRESET, name="home").success
    graph_host.until(lambda: vendor.last == PRESETS["home"], what="the trajectory")


def test_estop_keeps_the_arm_stiff_but_lets_a_limp_one_stiffen(graph_host: GraphHost, vendor: Any, console: Any) -> None:
    arm_nodes(graph_host, pinned_by=vendor)
    estop = EStop(graph_host, console)
    estop.set(True)
    refused = console.ask(graph.ARM_SET_TORQUE, data=False)
    assert not refused.success and refused.message.startswith("e-stop engaged") and vendor.calls == []
    estop.set(False)
    assert console.ask(graph.ARM_SET_TORQUE, data=False).success
    estop.set(True)
    assert console.ask(graph.ARM_SET_TORQUE, data=True).success
    assert vendor.calls == [("gate", False), ("torque", False), ("torque", True), ("gate", True)]
    assert list(vendor.trajectories[-1].points[-1].positions) == vendor.at


def test_estop_aborts_a_replay_and_a_release_does_not_resume_it(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    assert console.ask(graph.ARM_LIBRARY_PLAY, name="nod", speed=0.25).success
    graph_host.until(lambda: console.states[-1]["playing"], what="the playing state")
    estop = EStop(graph_host, console)
    estop.set(True)
    graph_host.until(lambda: not console.states[-1]["playing"], what="the end of the replay")
    assert console.states[-1]["aborted"] == "e-stop engaged"
    count, grips = len(vendor.trajectories), len(vendor.gripper_goals)
    held = list(vendor.trajectories[-1].points[-1].positions)
    assert held == vendor.at, "held where it is"
    estop.set(False)
    states = len(console.states)
    graph_host.until(lambda: len(console.states) > states + 10, what="two seconds")
    assert [list(sent.points[-1].positions) for sent in vendor.trajectories[count:]] == [held], "held once more"
    assert len(vendor.gripper_goals) == grips
    assert console.ask(graph.ARM_LIBRARY_PLAY, name="nod", speed=2.0).success


def test_replay_waiting_for_torque_is_refused_after_an_estop(
    graph_host: GraphHost, vendor: Any, console: Any, tmp_path: Path
) -> None:
    arm_nodes(graph_host, tmp_path, pinned_by=vendor)
    graph_host.until(lambda: console.states, what="the library's state")
    record(graph_host, vendor, console, "nod", "teleop")
    count = len(vendor.trajectories)
    estop = EStop(graph_host, console)
    play = console.send(graph.ARM_LIBRARY_PLAY, name="nod", speed=1.0)
    graph_host.until(lambda: len(vendor.trajectories) > count, what="the hold before the torque")  # 0.35 s before its end
    estop.set(True)
    estop.set(False)
    graph_host.until(play.done, what="the replay's answer")
    assert not play.result().success and play.result().message.startswith("e-stop engaged")
    graph_host.until(lambda: not console.states[-1]["playing"], what="the end of the replay")


@pytest.mark.parametrize("after_estop", [False, True], ids=["running", "sent-while-engaged"])
def test_estop_cancels_gripper_goals_of_any_client(graph_host: GraphHost, console: Any, after_estop: bool) -> None:
    import threading

    from control_msgs.action import GripperCommand
    from rclpy.action import ActionServer, CancelResponse
    from rclpy.callback_groups import ReentrantCallbackGroup

    from lupin_runtime.ros import LupinNode

    node, cancelled = LupinNode("vendor"), threading.Event()

    async def grip(goal: Any) -> GripperCommand_Result | None:
        from lupin_runtime.arm import async_wait

        while not goal.is_cancel_requested:
            await async_wait.sleep(node, 0.02)
        goal.canceled()
        cancelled.set()
        return GripperCommand.Result()

    server = ActionServer(
        node,
        GripperCommand,
        graph.GRIPPER_COMMAND.name,
        grip,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )
    graph_host.add(node)
    arm_nodes(graph_host)
    estop = EStop(graph_host, console)
    foreign = console.node.action_client(graph.GRIPPER_COMMAND)
    graph_host.until(foreign.server_is_ready, what="the gripper's action")
    if after_estop:
        estop.set(True)
    sent = graph_host.within(console.node, lambda: foreign.send_goal_async(GripperCommand.Goal()))
    graph_host.until(lambda: sent.done() and sent.result().accepted, what="the goal")
    estop.set(True)
    graph_host.until(cancelled.is_set, what="the goal's cancellation")
    server.destroy()


def test_trajectory_of_another_publisher_is_replaced_under_estop(
    graph_host: GraphHost, vendor: Vendor, console: Console
) -> None:
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    arm_nodes(graph_host, pinned_by=vendor)
    foreign = console.node.publisher(graph.ARM_TRAJECTORY)
    graph_host.until(lambda: foreign.get_subscription_count() >= 2, what="the subscriptions")
    estop = EStop(graph_host, console)
    estop.set(True)
    graph_host.until(lambda: len(vendor.trajectories) >= 2, what="the hold")
    held = list(vendor.trajectories[-1].points[-1].positions)
    point = JointTrajectoryPoint(positions=[0.9, 0.0, 0.0, 0.0])
    point.time_from_start.sec = 3
    foreign.publish(JointTrajectory(joint_names=list(graph.ARM_JOINTS), points=[point]))
    graph_host.until(lambda: len(vendor.trajectories) >= 4, what="the second hold")
    assert list(vendor.trajectories[-1].points[-1].positions) == held
    estop.set(False)
    graph_host.until(lambda: len(vendor.trajectories) >= 5, what="the hold with the release")
    assert list(vendor.trajectories[-1].points[-1].positions) == held
    count = len(vendor.trajectories)
    foreign.publish(JointTrajectory(joint_names=list(graph.ARM_JOINTS), points=[point]))
    graph_host.until(lambda: len(vendor.trajectories) > count and console.ask(graph.ARM_PRESET, name="home").success)
    assert len(vendor.trajectories[count].points) == 1 and vendor.trajectories[count].points[0].positions[0] == 0.9
