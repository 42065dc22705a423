"""A participant of the graph, on the laptop or the robot: it causes a fault while it runs, or executes one command.

    python -m tests.support.graph_participant ROLE [ARGUMENT ...]

It prints `up` once the role is active or the command was executed. After a command it exits, otherwise it runs until SIGTERM.
"""

from __future__ import annotations

import dataclasses
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

# SIGTERM is blocked before an import starts a thread: a thread that does not block it would let it kill the process.
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})

import rclpy
from rclpy.signals import SignalHandlerOptions

from lupin_runtime import graph
from lupin_runtime.drive.twist import ZERO, encode
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
from tests.support.waiting import wait_until

# Roles that execute one command: the first three are for the simulated robot, the last for the controller manager.
COMMANDS = ("sim", "battery", "press", "switch")


class Participant:
    """A node that takes one role."""

    def __init__(self, role: str) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.role = role
        self.node = LupinNode(f"participant_{role}")

    def wait_until(self, condition: Callable[[], Any]) -> None:
        def spin() -> None:
            rclpy.spin_once(self.node, timeout_sec=0.05)

        wait_until(condition, f"a counterpart of the role {self.role} on the graph", interval_s=0.0, each=spin)

    def repeat(self, row: Any, message: Any, period_s: float = 0.05) -> None:
        publisher = self.node.publisher(row)
        self.node.create_timer(period_s, lambda: publisher.publish(message))

    def publish_once(self, row: Any, **fields: Any) -> None:
        publisher = self.node.publisher(row)
        self.wait_until(lambda: publisher.get_subscription_count() > 0)
        for _ in range(20):  # on a busy machine, a subscription that is counted may be matched seconds later
            publisher.publish(interface(row.type)(**fields))
            time.sleep(0.1)

    def call(self, row: Any, **fields: Any) -> Any:
        client = self.node.client(row)
        self.wait_until(client.service_is_ready)
        future = client.call_async(interface(row.type).Request(**fields))
        self.wait_until(future.done)
        return future.result()

    def start(self, arguments: list[str]) -> None:
        """Take the role, or execute its command."""
        match self.role:
            case "page":
                self.repeat(graph.CMD_VEL_MANUAL, encode(ZERO))
            case "gamepad":
                self.repeat(graph.CMD_VEL_JOY, encode(ZERO))
            case "stop":
                self.repeat(graph.HMI_ESTOP, interface(graph.HMI_ESTOP.type)(data=True), 0.2)
            case "camera":
                self.node.publisher(graph.camera_info(graph.BODY_IMAGE_ROBOT))
                if arguments == ["works"]:
                    self.repeat(graph.camera_info(graph.GRIPPER_IMAGE), interface("sensor_msgs/msg/CameraInfo")())
            case "reader":
                self.node.subscription(graph.SCAN, lambda _: None, qos=graph.REL10)
            case "mistyped":
                self.node.subscription(dataclasses.replace(graph.SCAN, type=graph.BATTERY.type), lambda _: None)
            case "sink":
                nonexistent = "/mirte_base_controller/cmd_vel_unstamped"
                self.repeat(dataclasses.replace(graph.CMD_VEL_SINK_ROBOT, name=nonexistent), encode(ZERO))
            case "sim":
                self.publish_once(graph.SIM_FAULT, data=" ".join(arguments))
            case "battery":
                self.publish_once(graph.SIM_BATTERY, data=float(arguments[0]))
            case "press":
                self.call(graph.SIM_PRESS_ESTOP, data=arguments[0] == "yes")
            case "switch":
                names = {f"{arguments[0]}_controllers": [arguments[1]]}
                assert self.call(graph.SWITCH_CONTROLLER, strictness=2, **names).ok
            case "talker":
                pass
            case role:
                sys.exit(f"unknown role {role}")

    def spin_until_sigterm(self) -> None:
        sigterm_received = threading.Event()

        def wait_for_sigterm() -> None:
            signal.sigwait({signal.SIGTERM})
            sigterm_received.set()

        threading.Thread(target=wait_for_sigterm, daemon=True).start()
        while not sigterm_received.is_set():
            rclpy.spin_once(self.node, timeout_sec=0.1)


def main() -> None:
    role, *arguments = sys.argv[1:]
    participant = Participant(role)
    participant.start(arguments)
    print("up", flush=True)
    if role in COMMANDS:
        time.sleep(0.5)  # the last samples must be sent before the publisher is destroyed
    else:
        participant.spin_until_sigterm()
    participant.node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
