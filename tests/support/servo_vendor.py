"""A fake vendor of the arm's servos that records its calls, for tests of the calibration."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lupin_runtime import graph
from lupin_runtime.arm.calibration import HOME_COUNTS

if TYPE_CHECKING:
    from mirte_msgs.srv import GetServoOffset_Request, GetServoOffset_Response, SetServoAngle_Response, SetServoOffset_Response
    from std_srvs.srv import SetBool_Response

    from tests.conftest import GraphHost


class Servos:
    """The vendor's servo bus: offsets, positions, gate and torque, and the order of its calls."""

    def __init__(self, host: GraphHost) -> None:
        from mirte_msgs.msg import ServoPosition
        from sensor_msgs.msg import JointState

        from lupin_runtime.ros import LupinNode

        self.offsets = dict.fromkeys(HOME_COUNTS, 40)
        self.raw = {servo: home + 1000 for servo, home in HOME_COUNTS.items()}
        self.calls: list[tuple[Any, ...]] = []
        self.broken: set[tuple[Any, ...]] = set()
        self.node = LupinNode("servos")
        self.node.subscription(graph.ARM_TRAJECTORY, lambda _: self.calls.append(("pin",)))
        self.node.service(graph.VENDOR_TORQUE, self._switch("torque"))
        self.node.service(graph.VENDOR_ARM_GATE, self._switch("gate"))
        publishers = {servo: self.node.publisher(graph.servo_position(servo)) for servo in HOME_COUNTS}
        joints = self.node.publisher(graph.JOINT_STATES)
        for servo in HOME_COUNTS:
            self.node.service(graph.servo_offset(servo), self._get(servo))
            self.node.service(graph.servo_set_offset(servo), self._set(servo))
            self.node.service(graph.servo_set_angle(servo), self._angle(servo))

        def speak() -> None:
            joints.publish(JointState(name=list(graph.ARM_JOINTS), position=[0.0] * 4))
            for servo, publisher in publishers.items():
                publisher.publish(ServoPosition(raw=self.raw[servo]))

        self.node.create_timer(0.02, speak)
        host.add(self.node)

    def _switch(self, name: str) -> Callable[..., Any]:
        def serve(request: Any, response: SetBool_Response) -> SetBool_Response:
            self.calls.append((name, request.data))
            response.success = (name, request.data) not in self.broken
            response.message = "" if response.success else "out of order"
            return response

        return serve

    def _get(self, servo: str) -> Callable[..., Any]:
        def serve(_: GetServoOffset_Request, response: GetServoOffset_Response) -> GetServoOffset_Response:
            response.centidegrees = self.offsets[servo]
            return response

        return serve

    def _set(self, servo: str) -> Callable[..., Any]:
        def serve(request: Any, response: SetServoOffset_Response) -> SetServoOffset_Response:
            self.offsets[servo] = request.centidegrees
            self.calls.append(("offset", servo, request.centidegrees))
            return response

        return serve

    def _angle(self, servo: str) -> Callable[..., Any]:
        def serve(request: Any, response: SetServoAngle_Response) -> SetServoAngle_Response:
            self.calls.append(("angle", servo, request.angle))
            response.status = ("angle", servo) not in self.broken
            return response

        return serve
