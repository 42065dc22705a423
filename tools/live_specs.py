"""Runs the specs of web/tests/live, the page in Chromium against a whole run: `python tools/build_page.py live [NAME...]`.

The run drives in a small world, where a mission takes a minute. It begins with a fault that a person resets: navigation comes
up after the mission gave up waiting for it. The run uses the console's usual ports. Its state and the arm's library are in a
folder of its own, which is kept if a spec fails. All specs take about 18 minutes and need the machine's cores for themselves.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.detached_run import start_run, stop_run
from lupin_runtime import graph
from lupin_runtime.arm.library import Library, StoredSequence, Waypoint, to_json
from lupin_runtime.arm.store import default_path
from lupin_runtime.console.description import read_description
from lupin_runtime.console.voice_key import key_file, write_key
from lupin_runtime.console.voice_token import SERVICE_VARIABLE
from lupin_runtime.stack.runs import Run
from tests.support.live_server import KEY
from tools.build_page import WEB, BuildError, build, find_chromium, install_packages, node_path

UP = ("--world", "walled", "--no-record", "--no-nav2")
IMPATIENT_MISSION = (
    "mission",
    "-p",
    "MissionOrchestrator.dependency_timeout_s=1.0",
    "-p",
    "MissionOrchestrator.monitoring_sweeps=1",
)
# What the operator has the arm do by voice in tour.spec.ts: it leans aside, and comes back.
UPRIGHT, ASIDE = (0.0, 0.0, 0.0, -1.57), (0.5, 0.0, 0.3, -1.2)
SEQUENCE = "water"
WAIT_TIMEOUT_S = 120.0
SPECS_TIMEOUT_S = 1800.0
_END_TIMEOUT_S = 20.0


@contextmanager
def processes_beside(logs: Path) -> Iterator[Callable[[str, Sequence[str]], None]]:
    """Return a function that starts a command, with its output in a file of this name; all of them end with the block."""
    started: list[subprocess.Popen[bytes]] = []

    def start(name: str, command: Sequence[str]) -> None:
        with (logs / f"{name}.log").open("wb") as output:
            started.append(subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT))

    try:
        yield start
    finally:
        for process in started:
            process.terminate()
        for process in started:
            try:
                process.wait(_END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def prepare_voice_service() -> list[str]:
    """Store a key, and tell the console the address of a voice service on this computer; return the command that starts it."""
    write_key(key_file(), KEY)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    os.environ[SERVICE_VARIABLE] = f"http://127.0.0.1:{port}"
    return [sys.executable, "-m", "tests.support.live_server", "--port", str(port)]


def prepare_arm_library() -> None:
    """Store a sequence of the arm."""
    waypoints = (Waypoint(0.0, UPRIGHT), Waypoint(2.0, ASIDE), Waypoint(5.0, ASIDE), Waypoint(7.0, UPRIGHT))
    library = Library(sequences={SEQUENCE: StoredSequence("teleop", False, waypoints[-1].t, waypoints)})
    default_path().parent.mkdir(parents=True)
    default_path().write_text(to_json(library))


def run_specs(run: Run, chromium: str, names: Sequence[str]) -> int:
    """Run the specs whose files are named, or all, against a run with a console; return Playwright's exit status."""
    described = read_description(run.path)
    if described is None:
        raise BuildError(f"the run has no console; see {run.logs / 'console.log'}")
    path = node_path()
    install_packages(path)
    environment = {
        **os.environ,
        "PATH": path,
        "LUPIN_CHROMIUM": chromium,
        "LUPIN_CONSOLE": described.url.rstrip("/"),
        "LUPIN_RUN": str(run.path),
    }
    # The browsers end with this process, however it ends.
    command = [sys.executable, "-m", "lupin_cli.run.process_group", "node_modules/.bin/playwright", "test", *names]
    with subprocess.Popen(command, cwd=WEB, env=environment, stdin=subprocess.PIPE) as playwright:
        try:
            return playwright.wait(SPECS_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            print(f"the specs were not over within {SPECS_TIMEOUT_S:.0f} s", file=sys.stderr)
            return 1
        finally:
            assert playwright.stdin is not None
            playwright.stdin.close()


def wait_for_navigation() -> None:
    """Wait until the graph of this process's environment has navigation's action server. Raises BuildError."""
    import rclpy

    rclpy.init(args=[])
    node = rclpy.create_node("live_specs")
    try:
        _wait(lambda: node.count_services(f"{graph.NAVIGATE_TO_POSE.name}/_action/send_goal") > 0, "navigation")
    finally:
        node.destroy_node()
        rclpy.shutdown()


def _wait(condition: Callable[[], bool], what: str) -> None:
    print(f"waiting for {what}", flush=True)
    deadline_s = time.monotonic() + WAIT_TIMEOUT_S
    while not condition():
        if time.monotonic() > deadline_s:
            raise BuildError(f"waited {WAIT_TIMEOUT_S:.0f} s for {what}")
        time.sleep(0.2)


def main(names: Sequence[str]) -> int:
    """Start the run, run the specs, and end it; return the exit status."""
    chromium = find_chromium()
    if chromium is None:
        raise BuildError("there is no Chromium: apt-get install chromium")
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    build()
    state = Path(tempfile.mkdtemp(prefix="lupin-live-"))
    os.environ["XDG_STATE_HOME"], os.environ["XDG_CONFIG_HOME"] = str(state), str(state / "config")
    prepare_arm_library()
    voice_service = prepare_voice_service()
    print(f"starting the stack, with its state in {state}", flush=True)
    run = start_run(UP)
    status = 1
    try:
        with processes_beside(run.logs) as start:
            start("voice-service", voice_service)
            lupin_run = (sys.executable, "-m", "lupin_cli.app", "run", "--run", run.id)
            start("mission-beside", (*lupin_run, *IMPATIENT_MISSION))
            _wait(lambda: run.state().get("mission", {}).get("lifecycle_state") == "FAULT", "a mission that gave up")
            start("nav-beside", (*lupin_run, "nav"))
            wait_for_navigation()
            status = run_specs(run, chromium, names)
    finally:
        stop_run(run)
        if status == 0:
            shutil.rmtree(state)
        else:
            print(f"the logs of the run: {run.logs}", file=sys.stderr)
    return status


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except BuildError as error:
        sys.exit(f"the live specs: {error}")
