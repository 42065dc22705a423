"""Calibration under the e-stop, on the simulator's servo bus: no servo moves after the press, and nothing is lost."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.arm.calibration import HOME_COUNTS
from lupin_runtime.arm.motion import Refused
from lupin_sim.servos import NAMES, RAD_PER_COUNT, ServoBus
from tests.support.waiting import WAIT_S

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

STEP_S = 0.02
ANSWER_S = 0.1  # the servo bus is slow
OFFSET = 1500  # counts: 15 degrees
START = [0.6, 0.9, -1.9, 0.8, 0.2]  # rad
AT_REST_RAD = 0.02
# From the press to the last motion: the e-stop's message and a servo's next position (10 Hz), at 2 rad/s.
STOP_RAD = 1.0


class Robot:
    """The vendor's servo bus and telemetry, and the e-stop's state. Its joints are where the servos want them to be."""

    def __init__(self, host: GraphHost) -> None:
        from mirte_msgs.msg import ServoPosition
        from rclpy.callback_groups import ReentrantCallbackGroup
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Bool

        from lupin_runtime.ros import LupinNode

        self.bus = ServoBus(list(START))
        self.bus.offsets_counts = [0, *[OFFSET] * len(HOME_COUNTS)]
        self.physical = self.bus.targets(0.0)
        self.bus.read(self.physical)
        self.command: list[float | None] = [None] * 5
        self.engaged = False
        self.is_press_known: Callable[[], bool] = bool
        self.held: Any = None  # the call that is answered once the press is known
        self.refuses: set[str] = set()
        self.calls: list[tuple[str, Any]] = []
        self.node = LupinNode("vendor")
        self.node.subscription(graph.ARM_TRAJECTORY, self._on_trajectory)
        self.node.service(graph.VENDOR_TORQUE, self._set_torque)
        self.node.service(graph.VENDOR_ARM_GATE, self._set_gate)
        group, positions = ReentrantCallbackGroup(), {}
        for index, name in enumerate(NAMES):
            self.node.service(graph.servo_set_angle(name), partial(self._set_angle, index), group)
            self.node.service(graph.servo_offset(name), partial(self._get_offset, index), group)
            self.node.service(graph.servo_set_offset(name), partial(self._set_offset, index), group)
            positions[index] = self.node.publisher(graph.servo_position(name))
        joints, estop = self.node.publisher(graph.JOINT_STATES), self.node.publisher(graph.ESTOP_STATE)

        def step() -> None:
            self.bus.write(self.command)
            self.physical = self.bus.targets(STEP_S) if self.bus.torque else self.physical
            self.bus.read(self.physical)
            joints.publish(JointState(name=[*graph.ARM_JOINTS, graph.GRIPPER_JOINT], position=list(self.bus.angles)))

        def tell_positions() -> None:
            for index, publisher in positions.items():
                publisher.publish(ServoPosition(angle=self.bus.angles[index], raw=self.bus.raw_counts(index)))

        self.node.create_timer(STEP_S, step)
        self.node.create_timer(0.1, tell_positions)
        self.node.create_timer(0.1, lambda: estop.publish(Bool(data=self.engaged)))
        host.add(self.node)

    def _on_trajectory(self, message: Any) -> None:
        self.command = [*message.points[-1].positions, None]

    def _set_torque(self, request: Any, response: Any) -> Any:
        self.bus.set_torque(request.data)
        response.success = True
        return response

    def _set_gate(self, request: Any, response: Any) -> Any:
        self.bus.gate_open = request.data
        response.success = True
        return response

    async def _set_angle(self, index: int, request: Any, response: Any) -> Any:
        self.calls.append((NAMES[index], request.angle))
        response.status = NAMES[index] not in self.refuses
        if response.status:
            self.bus.set_angle(index, request.angle)
        return await self._answer(self.calls[-1], response)

    async def _answer(self, call: Any, response: Any) -> Any:
        from lupin_runtime.arm import async_wait

        await async_wait.sleep(self.node, ANSWER_S)
        if call == self.held:
            while not self.is_press_known():
                await async_wait.sleep(self.node, STEP_S)
            self.held = None
        return response

    async def _get_offset(self, index: int, _: Any, response: Any) -> Any:
        response.centidegrees = self.bus.offsets_counts[index]
        return await self._answer(f"offset of {NAMES[index]}", response)

    async def _set_offset(self, index: int, request: Any, response: Any) -> Any:
        self.calls.append((f"offset of {NAMES[index]}", request.centidegrees))
        self.bus.offsets_counts[index] = request.centidegrees
        return await self._answer(self.calls[-1], response)

    @property
    def offsets(self) -> dict[str, int]:
        return dict(zip(NAMES[1:], self.bus.offsets_counts[1:]))

    def pose_by_hand(self, angle_rad: float) -> None:
        """Move the limp joints so that their encoders read this angle without an offset."""
        self.physical = [angle_rad] * 5


@pytest.fixture
def robot(graph_host: GraphHost) -> Robot:
    return Robot(graph_host)


class Operator:
    """Calls `/lupin/arm/calibrate` on a server with short waits, and presses the e-stop."""

    def __init__(self, host: GraphHost, robot: Robot) -> None:
        from lupin_runtime.arm.node import ArmCalibrateServer, ArmPresetServer
        from lupin_runtime.ros import LupinNode

        self._host, self._robot = host, robot
        presets: Any = host.add(ArmPresetServer())
        self.motion = presets.motion
        host.add(ArmCalibrateServer())
        node = host.add(LupinNode("operator"))
        self._client = node.client(graph.ARM_CALIBRATE)
        host.until(self._client.service_is_ready, what="the service")
        host.until(lambda: self.motion.state(fresh=True), what="the arm's pose")
        host.until(lambda: not self._is_refused(), what="the e-stop's state")
        robot.is_press_known = self._is_refused

    def send(self, action: str) -> Any:
        from lupin_msgs.srv import CalibrateArm

        return self._client.call_async(CalibrateArm.Request(action=action))

    def answer(self, future: Any) -> Any:
        self._host.until(future.done, what="the answer")
        return future.result()

    def ask(self, action: str) -> Any:
        return self.answer(self.send(action))

    def press(self, engaged: bool) -> None:
        self._robot.engaged = engaged
        self._host.until(lambda: self._is_refused() is engaged, what=f"the e-stop's state {engaged}")

    def _is_refused(self) -> bool:
        try:
            self.motion.require_released()
        except Refused:
            return True
        return False

    def rest(self) -> list[float]:
        """Wait until no joint moves, and return their true angles."""
        seen = [list(self._robot.physical)]

        def is_at_rest() -> bool:
            seen.append(list(self._robot.physical))
            recent = seen[-150:]  # 0.3 s
            return len(recent) == 150 and change(recent[0], recent[-1]) < 1e-6

        self._host.until(is_at_rest, what="rest")
        return seen[-1]


def change(one: list[float], other: list[float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other))


@pytest.fixture
def operator(graph_host: GraphHost, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Operator:
    from lupin_runtime.arm import calibrate_server

    monkeypatch.setattr(calibrate_server, "SETTLE_S", 0.1)
    monkeypatch.setattr(calibrate_server, "SAMPLE_S", 0.3)
    monkeypatch.setattr(calibrate_server, "CALL_S", WAIT_S)  # the robot holds an answer until the press is known
    return Operator(graph_host, robot)


def press_during_start(host: GraphHost, operator: Operator, condition: Callable[[], Any]) -> Any:
    """Start a calibration, press the e-stop once the condition holds, and return the start's answer."""
    start = operator.send("start")
    host.until(condition, what="the moment of the press")
    operator.press(True)
    return operator.answer(start)


def press_at(host: GraphHost, operator: Operator, robot: Robot, call: tuple[str, float]) -> Any:
    """Start a calibration, press the e-stop before the robot answers this call, and return the start's answer."""
    robot.held = call
    return press_during_start(host, operator, lambda: call in robot.calls)


def is_moving(robot: Robot, servo: str) -> bool:
    index = NAMES.index(servo)
    return (servo, 0.0) in robot.calls and 0.1 < abs(robot.bus.angles[index]) < abs(START[index])


def test_press_stops_moving_servos_and_keeps_their_offsets(graph_host: GraphHost, robot: Robot, operator: Operator) -> None:
    pressed_at: list[list[float]] = []

    def elbow_moves() -> bool:
        pressed_at[:] = [list(robot.physical)]
        return is_moving(robot, "elbow")

    answer = press_during_start(graph_host, operator, elbow_moves)
    assert not answer.success and answer.message.startswith("e-stop engaged")
    assert "cancel restores the offsets" in answer.message and "elbow" in answer.message
    at = operator.rest()
    assert change(at, pressed_at[0]) < STOP_RAD, "without a stop the elbow would have gone on to zero"
    assert abs(at[NAMES.index("elbow")]) > 0.1
    assert robot.offsets["elbow"] == 0, "written back, it would move the servo under the e-stop"
    assert not robot.bus.gate_open and robot.bus.torque
    assert change(operator.rest(), at) < AT_REST_RAD

    calls = list(robot.calls)
    status = operator.ask("status")
    assert status.success and "cancel restores the offsets" in status.message
    for action in ("start", "commit", "cancel"):
        refused = operator.ask(action)
        assert not refused.success and refused.message.startswith("e-stop engaged"), action
    assert robot.calls == calls
    operator.press(False)
    assert change(operator.rest(), at) < AT_REST_RAD, "the release moves nothing"
    assert not operator.ask("start").success, "the offsets must be restored first"
    answer = operator.ask("cancel")
    assert answer.success and answer.state == "IDLE", answer.message
    assert robot.offsets == dict.fromkeys(HOME_COUNTS, OFFSET)
    assert robot.bus.gate_open and operator.ask("status").message == "no calibration is in progress"


def test_press_before_the_next_offset_writes_none(graph_host: GraphHost, robot: Robot, operator: Operator) -> None:
    answer = press_at(graph_host, operator, robot, ("shoulder_lift", 0.0))
    assert not answer.success
    operator.rest()
    assert [call for call in robot.calls if call[0].startswith("offset")] == [("offset of shoulder_lift", 0)]


def test_press_before_the_first_step_leaves_the_arm_ready(graph_host: GraphHost, robot: Robot, operator: Operator) -> None:
    before = list(robot.physical)
    robot.held = "offset of shoulder_lift"
    answer = press_during_start(graph_host, operator, lambda: not robot.bus.gate_open)
    assert not answer.success and answer.state == "IDLE"
    assert change(operator.rest(), before) < AT_REST_RAD
    assert robot.bus.gate_open and robot.calls == []
    operator.press(False)
    assert operator.ask("start").success


def test_limp_arm_is_cancelled_under_the_estop_without_motion(robot: Robot, operator: Operator) -> None:
    assert operator.ask("start").success
    robot.pose_by_hand(0.3)
    operator.press(True)
    before = operator.rest()
    refused = operator.ask("commit")
    assert not refused.success and refused.state == "AWAITING_POSE"
    answer = operator.ask("cancel")
    assert answer.success and answer.state == "IDLE", answer.message
    assert robot.offsets == dict.fromkeys(HOME_COUNTS, OFFSET)
    assert robot.bus.torque and robot.bus.gate_open
    assert change(operator.rest(), before) < AT_REST_RAD
    operator.press(False)
    assert change(operator.rest(), before) < AT_REST_RAD


def test_press_during_the_readings_of_a_commit_writes_nothing(robot: Robot, operator: Operator) -> None:
    assert operator.ask("start").success
    robot.pose_by_hand(math.radians(5.0))
    robot.held = "offset of shoulder_lift"
    commit = operator.send("commit")
    operator.press(True)
    answer = operator.answer(commit)
    robot.held = None
    assert not answer.success and answer.state == "AWAITING_POSE"
    assert set(robot.offsets.values()) == {0} and not robot.bus.torque
    operator.press(False)
    answer = operator.ask("commit")
    assert answer.success, answer.message
    assert set(robot.offsets.values()) == {round(math.radians(5.0) / RAD_PER_COUNT)}


def test_press_during_the_moves_of_a_commit_holds_the_servos(graph_host: GraphHost, robot: Robot, operator: Operator) -> None:
    assert operator.ask("start").success
    robot.pose_by_hand(math.radians(20.0))
    robot.calls.clear()
    robot.bus.offsets_counts[0] = 0
    commit = operator.send("commit")
    graph_host.until(lambda: len([call for call in robot.calls if call[0].startswith("offset")]) == 4, what="the offsets")
    # Somebody moves the limp arm away from the pose that was read, so that the servos have far to go.
    robot.pose_by_hand(1.2)
    graph_host.until(lambda: is_moving_from(robot, "elbow", 1.2 - math.radians(20.0)), what="motion")
    operator.press(True)
    answer = operator.answer(commit)
    assert not answer.success and answer.state == "IDLE" and "the offsets are written" in answer.message
    at = operator.rest()
    assert abs(robot.bus.angles[NAMES.index("elbow")]) > 0.1
    operator.press(False)
    assert change(operator.rest(), at) < AT_REST_RAD


def is_moving_from(robot: Robot, servo: str, angle_rad: float) -> bool:
    return (servo, 0.0) in robot.calls and abs(robot.bus.angles[NAMES.index(servo)]) < angle_rad - 0.05


def test_press_during_the_restoration_keeps_what_is_left(graph_host: GraphHost, robot: Robot, operator: Operator) -> None:
    robot.refuses = {"gripper"}  # the start fails at the last servo, and restores the offsets
    answer = press_at(graph_host, operator, robot, ("offset of shoulder_lift", OFFSET))
    assert not answer.success
    at = operator.rest()
    left = [servo for servo, offset in robot.offsets.items() if offset == 0]
    assert left and all(servo in answer.message for servo in left)
    operator.press(False)
    assert change(operator.rest(), at) < AT_REST_RAD
    assert operator.ask("cancel").success
    assert robot.offsets == dict.fromkeys(HOME_COUNTS, OFFSET)
