"""What the robot's controller manager lists, asked on the robot itself with the ROS that its own stack uses."""

from __future__ import annotations

import json

from lupin_cli.onboard import RELEASE, set_up
from lupin_cli.operations.shell import look, quote
from lupin_cli.target.base import Target
from lupin_runtime.graph import CONTROLLERS

_ASK_S = 25.0

# A node for one question. It prints one line of JSON, and nothing where nobody answers in time.
_ASK = """
import json, os, sys, rclpy
from controller_manager_msgs.srv import ListControllers
rclpy.init(args=[])
node = rclpy.create_node("lupin_controllers", start_parameter_services=False, enable_rosout=False)
client = node.create_client(ListControllers, "/controller_manager/list_controllers")
if client.wait_for_service(timeout_sec=15.0):
    future = client.call_async(ListControllers.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
    if future.done():
        print("states " + json.dumps({c.name: c.state for c in future.result().controller}), flush=True)
node.destroy_node()  # or it is on the graph for 20 s more
os._exit(0)
"""


def controller_states(target: Target) -> dict[str, str] | None:
    """State by name; None where the controller manager does not answer."""
    # The vendor's hooks count on a bash, which goes on where a file isn't there on this robot.
    python = f"python={RELEASE}/venv/bin/python3; [ -x $python ] || python=python3"
    script = "\n".join([*set_up(), python, f"exec $python -c {quote(_ASK)}"])
    output = look(target, f"exec bash -c {quote(script)}", bound_s=_ASK_S)
    for line in output.stdout.splitlines():
        if line.startswith("states "):
            states: dict[str, str] = json.loads(line.removeprefix("states "))
            return states
    return None


def complaints(states: dict[str, str] | None) -> list[str]:
    """What each of the five is that should be active; one line where nobody answers."""
    if states is None:
        return ["the controller manager does not answer"]
    return [f"{name} is {states.get(name, 'not loaded')}" for name in CONTROLLERS if states.get(name) != "active"]
