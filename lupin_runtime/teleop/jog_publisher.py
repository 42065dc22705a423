"""Publishes the rates by which a pad moves the arm."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterable

from sensor_msgs.msg import JointState

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode, stamp_from_ns
from lupin_runtime.teleop.arm_jogger import ArmRates

_JOINTS = (*graph.ARM_JOINTS, graph.GRIPPER_JOINT)


class JogPublisher:
    """A publisher of rates. Its source has the name of this computer and process: another one's do not continue its jog."""

    def __init__(self, node: LupinNode) -> None:
        self._node = node
        self._publisher = node.publisher(graph.ARM_JOG)
        self._source = f"the gamepad of {socket.gethostname()} ({os.getpid()})"

    def publish(self, commands: Iterable[ArmRates]) -> None:
        """Publish rates, in order."""
        for rates in commands:
            message = JointState(name=list(_JOINTS), velocity=list(rates))
            message.header.stamp, message.header.frame_id = stamp_from_ns(self._node.now_ns()), self._source
            self._publisher.publish(message)
