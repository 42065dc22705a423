"""`lupin up` as a child process of the test, with its own state folder."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

UP_TIMEOUT_S = 90.0


class Up:
    """A running `lupin up`."""

    def __init__(self, home: Path, *arguments: str, prefix: tuple[str, ...] = ()) -> None:
        self.home = home
        self.environment = {**os.environ, "XDG_STATE_HOME": str(home)}
        # Runs of other tests are up at the same time, and the console's ports exist only once on a machine.
        arguments = arguments if "--web" in arguments else (*arguments, "--no-web")
        command = [*prefix, sys.executable, "-m", "lupin_cli.app", "up", *arguments]
        self.process = subprocess.Popen(
            command,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def folder(self) -> Path | None:
        """Return the run's directory; None before it exists."""
        for path in (self.home / "lupin" / "runs").glob("*"):
            if (path / "run.json").exists() and json.loads((path / "run.json").read_text())["pid"] == self.process.pid:
                return path
        return None

    def state(self) -> dict[str, Any]:
        """Return the last state that the supervisor wrote; empty before the first."""
        folder = self.folder()
        if folder is None or not (folder / "state.json").exists():
            return {}
        return {**json.loads((folder / "state.json").read_text()), "run": json.loads((folder / "run.json").read_text())}

    def simulator(self) -> dict[str, Any]:
        """Return the last state that the simulator wrote: true pose, velocity, collisions."""
        folder = self.folder()
        path = folder / "sim_state.json" if folder is not None else None
        return json.loads(path.read_text()) if path is not None and path.exists() else {}

    def until(self, condition: Callable[[dict[str, Any]], bool], what: str, timeout_s: float = UP_TIMEOUT_S) -> dict[str, Any]:
        """Return the first state in which the condition holds."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            state = self.state()
            if state.get("stages") and condition(state):
                return state
            assert self.process.poll() is None, f"exited while waiting for {what}: {self.process.communicate()}"
            time.sleep(0.1)
        raise AssertionError(f"no {what} within {timeout_s} s: {self.state()}")

    def wait_up(self) -> dict[str, Any]:
        """Return the first state in which every stage is up."""
        return self.until(lambda state: all(stage["phase"] == "up" for stage in state["stages"]), "stack that is up")

    def stage(self, name: str) -> dict[str, Any]:
        """Return one stage of the newest state."""
        return next(stage for stage in self.state()["stages"] if stage["name"] == name)

    def kill(self, name: str) -> int:
        """SIGKILL a process of the run; return its pid."""
        pid = int(self.stage(name)["pid"])
        os.kill(pid, signal.SIGKILL)
        return pid

    def lupin(self, *arguments: str, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
        """Run another `lupin` command of the same user."""
        return subprocess.run(
            [sys.executable, "-m", "lupin_cli.app", *arguments],
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )

    def speed_m_s(self) -> float:
        """Return the robot's true speed."""
        twist = self.simulator().get("twist") or [0.0, 0.0, 0.0]
        return float((twist[0] ** 2 + twist[1] ** 2) ** 0.5)

    def wait(self, condition: Callable[[], Any], what: str, timeout_s: float = UP_TIMEOUT_S) -> Any:
        """Wait for the first true value of the condition; fail if the run ends."""
        deadline = time.monotonic() + timeout_s
        while not (value := condition()):
            assert self.process.poll() is None, f"exited while waiting for {what}: {self.process.communicate()}"
            assert time.monotonic() < deadline, f"no {what} within {timeout_s:.0f} s: {self.simulator()} {self.state()}"
            time.sleep(0.1)
        return value

    def log(self, stage: str) -> str:
        """Return the log of a process of the run."""
        folder = self.folder()
        path = folder / "logs" / f"{stage}.log" if folder is not None else None
        return path.read_text(errors="replace") if path is not None and path.exists() else ""

    def children(self) -> list[psutil.Process]:
        """Return the live processes of the run."""
        pids = [stage["pid"] for stage in self.state()["stages"] if stage["pid"] is not None]
        return [psutil.Process(pid) for pid in pids if psutil.pid_exists(pid)]

    def result(self, timeout_s: float = 60.0) -> tuple[int, dict[str, Any]]:
        """Return exit status and the JSON object of a run that was started with --json."""
        out, err = self.process.communicate(timeout=timeout_s)
        assert out.strip(), err
        return self.process.returncode, json.loads(out)

    def end(self) -> None:
        """Kill the command if it still runs."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(10.0)
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


@pytest.fixture
def launch(tmp_path: Path) -> Iterator[Callable[..., Up]]:
    """Start `lupin up` with arguments; it is killed after the test."""
    made: list[Up] = []

    def start(*arguments: str, prefix: tuple[str, ...] = ()) -> Up:
        made.append(Up(tmp_path, *arguments, prefix=prefix))
        return made[-1]

    yield start
    for one in made:
        one.end()


class Observer:
    """A node of the test on the graph of a run, spun by its own thread."""

    def __init__(self, run: Up) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.task import Future

        from lupin_runtime.ros.node import LupinNode

        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=run.state()["run"]["domain"])
        self.node = LupinNode("observer", context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._end = Future()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        self._executor.spin_until_future_complete(self._end)

    def until(self, condition: Callable[[], Any], what: str, timeout_s: float = 30.0) -> Any:
        """Return the first true value of the condition."""
        deadline = time.monotonic() + timeout_s
        while not (value := condition()):
            assert time.monotonic() < deadline, f"no {what} within {timeout_s:.0f} s"
            time.sleep(0.02)
        return value

    def within(self, function: Callable[[], Any]) -> Any:
        """Run a function on the spinning thread, as action clients require, and return its value."""
        task = self._executor.create_task(function)
        self.until(task.done, "turn of the executor")
        return task.result()

    def publisher(self, topic: Any) -> Callable[[Any], None]:
        """Return a publisher that has matched a subscription."""
        made = self.node.publisher(topic)
        self.until(lambda: made.get_subscription_count() > 0, f"reader of {topic.name}")
        result: Callable[[Any], None] = made.publish
        return result

    def call(self, service: Any, request: Any) -> Any:
        """Return the service's response."""
        client = self.node.client(service)
        self.until(client.service_is_ready, f"server of {service.name}")
        future = client.call_async(request)
        self.until(future.done, f"answer of {service.name}")
        return future.result()

    def close(self) -> None:
        """Leave the graph."""
        self._end.set_result(None)
        self._thread.join(5.0)
        self._executor.shutdown(timeout_sec=2.0)
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def join() -> Iterator[Callable[[Up], Observer]]:
    """Join the graph of a run."""
    made: list[Observer] = []

    def observer(run: Up) -> Observer:
        made.append(Observer(run))
        return made[-1]

    yield observer
    for one in made:
        one.close()


@pytest.fixture(scope="session")
def make_up() -> type[Up]:
    """Return the class Up, for tests that share a run; the caller ends the run."""
    return Up
