"""The state of the five controllers: `python -m lupin_runtime.arm.list_controllers [--wait S]`.

Prints a line per controller, `NAME STATE`. Exit status 0 when all are active, 1 when one is not by the end of the wait, 2 when
nobody serves the list. Changes nothing; healing is what `auto_home` does.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

import rclpy

from lupin_runtime import graph
from lupin_runtime.arm.controllers import complaints
from lupin_runtime.ros import LupinNode

CALL_S, POLL_S = 5.0, 0.5
ALL_ACTIVE, NOT_ACTIVE, NO_MANAGER = 0, 1, 2


def watch(node: LupinNode, wait_s: float) -> dict[str, str] | None:
    """States by name, as soon as all are active or after `wait_s`; None where nobody ever answered."""
    client = node.client(graph.LIST_CONTROLLERS)
    deadline = time.monotonic() + wait_s
    states: dict[str, str] | None = None
    while True:
        left_s = deadline - time.monotonic()
        if client.wait_for_service(timeout_sec=max(0.0, left_s)):
            future = client.call_async(client.srv_type.Request())
            rclpy.spin_until_future_complete(node, future, timeout_sec=CALL_S)
            if future.done():
                states = {item.name: item.state for item in future.result().controller}
            else:
                client.remove_pending_request(future)
        if (states is not None and not complaints(states, graph.CONTROLLERS)) or time.monotonic() + POLL_S > deadline:
            return states
        time.sleep(POLL_S)


def main(arguments: list[str]) -> int:
    """Print the list."""
    parser = argparse.ArgumentParser(prog="list_controllers", description="The state of the robot's controllers.")
    parser.add_argument("--wait", type=float, default=10.0, help="s until all must be active")
    wait_s = parser.parse_args(arguments).wait
    rclpy.init(args=[])
    states = watch(LupinNode(f"list_controllers_{os.getpid()}", enable_rosout=False), wait_s)
    if states is None:
        print(f"nobody served {graph.LIST_CONTROLLERS.name} within {wait_s:g} s", file=sys.stderr)
        return NO_MANAGER
    for name in graph.CONTROLLERS:
        print(f"{name} {states.get(name, 'missing')}")
    return NOT_ACTIVE if complaints(states, graph.CONTROLLERS) else ALL_ACTIVE


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # the middleware's threads may take their time
