"""The states of the robot's controllers, read on the robot itself with the ROS that its own stack uses."""

from __future__ import annotations

from lupin_cli.connection.base import Output, Script
from lupin_cli.operations.base import OperationError, probe_script
from lupin_cli.operations.shell import quote
from lupin_cli.release.paths import RELEASE, setup_lines
from lupin_runtime.graph import CONTROLLERS, LIST_CONTROLLERS
from lupin_runtime.json_text import parse_json

_TIMEOUT_S = 25.0

# A node for one service call. It prints one line of JSON, or nothing if the service does not answer in time.
_LIST_CONTROLLERS = f"""
import json, os, sys, rclpy
from controller_manager_msgs.srv import ListControllers
rclpy.init(args=[])
node = rclpy.create_node("lupin_controllers", start_parameter_services=False, enable_rosout=False)
client = node.create_client(ListControllers, {LIST_CONTROLLERS.name!r})
if client.wait_for_service(timeout_sec=15.0):
    future = client.call_async(ListControllers.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
    if future.done():
        print("states " + json.dumps({{c.name: c.state for c in future.result().controller}}), flush=True)
node.destroy_node()  # otherwise the node stays on the graph for 20 s
os._exit(0)
"""


def controllers_probe() -> Script:
    """Return the probe that lists the controllers."""
    # The vendor's set-up files need bash, and they continue if a file that they source does not exist.
    python = f"python={RELEASE}/venv/bin/python3; [ -x $python ] || python=python3"
    script = "\n".join([*setup_lines(), python, f"PYTHONSAFEPATH=1 exec $python -c {quote(_LIST_CONTROLLERS)}"])
    return probe_script(f"exec bash -c {quote(script)}", timeout_s=_TIMEOUT_S)


def parse_controllers(output: Output) -> dict[str, str] | None:
    """Return the state of each controller by name; None if the controller manager did not answer. Raises OperationError."""
    for line in output.stdout.splitlines():
        if line.startswith("states "):
            try:
                states = parse_json(line.removeprefix("states "))
            except ValueError:
                states = None
            if not isinstance(states, dict) or not all(isinstance(state, str) for state in states.values()):
                raise OperationError(f"could not read the controllers: found {line[:80]!r}", "lupin doctor")
            return states
    return None


def find_inactive(states: dict[str, str] | None) -> list[str]:
    """Return a sentence for each of the five controllers that is not active, or one if there are no states."""
    if states is None:
        return ["the controller manager does not answer"]
    return [f"{name} is {states.get(name, 'not loaded')}" for name in CONTROLLERS if states.get(name) != "active"]
