"""Runs the WebSocket tests of rosbridge_suite, unmodified, against the console's server.

    python -m tools.run_rosbridge_tests FOLDER [NAME ...]
    python -m tools.run_rosbridge_tests --serve

FOLDER is a checkout of rosbridge_suite for ROS 2. Its tests use ROS 2's launch system to start the server; small modules stand
in for it. They also need the Python packages autobahn and twisted, and some of them example_interfaces; a test without them is
reported as failed, with the import error. Exit status: 0 all passed, 1 a test failed.

With --serve, it only serves rosbridge on port 9090, with a graph of its own in which clients may use any name. The suites of
roslibpy (`ROSLIBPY_TRANSPORT=twisted pytest tests/ros2 tests/test_*.py`, and the same with asyncio) and of roslibjs
(`npx vitest run`) expect such a server.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from lupin_runtime.console.ports import PortInUse, check_free
from lupin_runtime.console.publisher_pool import UNREGISTER_AFTER_S
from lupin_runtime.ports import ROSBRIDGE_PORT
from lupin_runtime.stack.dds import claim_domain, loopback_environment

TEST_TIMEOUT_S = 120.0
_STUBS = {
    "launch/__init__.py": (
        "from launch import actions, substitutions\nfrom launch.launch_description import LaunchDescription\n"
    ),
    "launch/action.py": "class Action: ...\n",
    "launch/launch_description.py": "class LaunchDescription:\n    def __init__(self, actions): self.actions = actions\n",
    "launch/actions.py": (
        "class DeclareLaunchArgument:\n    def __init__(self, *a, **k): ...\n"
        "class ExecuteProcess:\n    def __init__(self, cmd, **k): self.cmd = [str(word) for word in cmd]\n"
    ),
    "launch/substitutions.py": "class LaunchConfiguration:\n    def __init__(self, name): ...\n",
    "launch_ros/__init__.py": "from launch_ros import actions\n",
    "launch_ros/actions.py": "class Node:\n    def __init__(self, parameters, **k): self.parameters = parameters[0]\n",
    "launch_testing/__init__.py": "",
    "launch_testing/actions.py": "class ReadyToTest: ...\n",
}


def main() -> int:
    """Run every test file in a separate process, on a private graph."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, nargs="?", help="checkout of rosbridge_suite")
    parser.add_argument("names", nargs="*", help="test files to run, without .test.py; default: all")
    parser.add_argument("--serve", action="store_true", help="only serve rosbridge on port 9090, until Ctrl-C")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        return _serve()
    if options.folder is None:
        parser.error("name a checkout of rosbridge_suite, or type --serve")
    tests = options.folder / "rosbridge_server" / "test" / "websocket"
    files = sorted(path for path in tests.glob("*.test.py") if not options.names or path.name[:-8] in options.names)
    if not files:
        parser.error(f"no such test files in {tests}")
    if options.inside:
        return _run_inside(files[0])
    failed = 0
    with tempfile.TemporaryDirectory() as directory:
        for name, text in _STUBS.items():
            path = Path(directory) / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        for path in files:
            outcome = _run(path, options.folder, Path(directory))
            failed += outcome != "passed"
            print(f"{path.name[:-8]:32} {outcome}", flush=True)
    print(f"{len(files) - failed} passed, {failed} failed")
    return 1 if failed else 0


def _serve() -> int:
    try:
        check_free("127.0.0.1", ROSBRIDGE_PORT)
    except PortInUse as error:
        raise SystemExit(f"{error}; the suites use no other port: end that process first") from error
    claim = claim_domain()
    with tempfile.TemporaryDirectory() as directory:
        environment = loopback_environment(claim.domain, Path(directory), {**os.environ, "XDG_STATE_HOME": directory})
        command = [sys.executable, "-c", _SERVER, str(UNREGISTER_AFTER_S), str(ROSBRIDGE_PORT)]
        process = subprocess.Popen(command, env=environment, cwd=Path(__file__).parents[1])
        try:
            return process.wait()
        except KeyboardInterrupt:
            return process.wait(20)
        finally:
            claim.release()


def _run(path: Path, folder: Path, stubs: Path) -> str:
    claim = claim_domain()
    environment = loopback_environment(claim.domain, stubs, {**os.environ, "XDG_STATE_HOME": str(stubs)})
    folders = [str(stubs), str(Path(__file__).parents[1]), *sys.path[1:]]  # noqa: TID251 -- read, for another process
    environment["PYTHONPATH"] = os.pathsep.join(folders)
    command = [sys.executable, "-m", "tools.run_rosbridge_tests", "--inside", str(folder), path.name[:-8]]
    log = stubs / f"{path.name}.log"
    try:
        with log.open("w") as output:
            test = subprocess.Popen(command, env=environment, stdout=output, stderr=output, cwd=stubs, start_new_session=True)
        status = test.wait(TEST_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        os.killpg(test.pid, signal.SIGKILL)  # with the server that it has started
        test.wait()
        return f"timed out after {TEST_TIMEOUT_S:g} s"
    finally:
        claim.release()
    if status == 0:
        return "passed"
    return "failed: " + log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1]


def _run_inside(path: Path) -> int:
    """Start the processes that a test file describes, and run its tests. Once per process: a reactor cannot start twice."""
    import unittest

    spec = importlib.util.spec_from_file_location(path.name[:-8], path)
    assert spec is not None and spec.loader is not None  # the file exists
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    started = []
    try:
        for action in module.generate_test_description().actions:
            if hasattr(action, "parameters"):
                unregister_s = str(action.parameters.get("unregister_timeout", UNREGISTER_AFTER_S))
                started.append(subprocess.Popen([sys.executable, "-c", _SERVER, unregister_s, "0"]))
            elif hasattr(action, "cmd"):
                started.append(subprocess.Popen(action.cmd))
        result = unittest.TextTestRunner().run(unittest.defaultTestLoader.loadTestsFromModule(module))
    finally:
        for process in started:
            process.terminate()
            process.wait(20)
    return 0 if result.wasSuccessful() and result.testsRun else 1


# The tests read the port from the parameters of a node `rosbridge_websocket`.
_SERVER = """
import sys
from rclpy.node import Node
from lupin_runtime.console.node import Console
from lupin_runtime.ports import ROSBRIDGE_PORT
from lupin_runtime.ros import run

def announce(nodes):
    nodes[1].declare_parameter("actual_port", nodes[0].rosbridge_port)
    nodes[1].declare_parameter("port", ROSBRIDGE_PORT)

ports = {"port": 0, "rosbridge_port": int(sys.argv[2])}
parameters = {**ports, "unlisted": True, "unregister_after_s": float(sys.argv[1])}
sys.exit(run([lambda: Console(parameters), lambda: Node("rosbridge_websocket")], ready=announce))
"""


if __name__ == "__main__":
    sys.exit(main())
