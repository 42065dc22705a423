"""One `lupin up` as a child of the test, in a state folder of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

UP_BOUND_S = 90.0


class Up:
    """A running `lupin up`."""

    def __init__(self, home: Path, *arguments: str, prefix: tuple[str, ...] = ()) -> None:
        self.home = home
        self.environment = {**os.environ, "XDG_STATE_HOME": str(home)}
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
        """The run's directory, once there is one."""
        for path in (self.home / "lupin" / "runs").glob("*"):
            if (path / "run.json").exists() and json.loads((path / "run.json").read_text())["pid"] == self.process.pid:
                return path
        return None

    def state(self) -> dict[str, Any]:
        """The supervisor's last word; empty before the first."""
        folder = self.folder()
        if folder is None or not (folder / "state.json").exists():
            return {}
        return {**json.loads((folder / "state.json").read_text()), "run": json.loads((folder / "run.json").read_text())}

    def simulator(self) -> dict[str, Any]:
        """The simulator's last word on where the robot truly is and what it hit."""
        folder = self.folder()
        path = folder / "sim_state.json" if folder is not None else None
        return json.loads(path.read_text()) if path is not None and path.exists() else {}

    def until(self, condition: Callable[[dict[str, Any]], bool], what: str, bound_s: float = UP_BOUND_S) -> dict[str, Any]:
        """The first state in which the condition holds."""
        deadline = time.monotonic() + bound_s
        while time.monotonic() < deadline:
            state = self.state()
            if state.get("stages") and condition(state):
                return state
            assert self.process.poll() is None, f"ended while waiting for {what}: {self.process.communicate()}"
            time.sleep(0.1)
        raise AssertionError(f"no {what} within {bound_s} s: {self.state()}")

    def wait_up(self) -> dict[str, Any]:
        """The first state in which every stage is up."""
        return self.until(lambda state: all(stage["phase"] == "up" for stage in state["stages"]), "stack that is up")

    def stage(self, name: str) -> dict[str, Any]:
        """One stage of the newest state."""
        return next(stage for stage in self.state()["stages"] if stage["name"] == name)

    def kill(self, name: str) -> int:
        """SIGKILL a process of the run; returns its pid."""
        pid = int(self.stage(name)["pid"])
        os.kill(pid, signal.SIGKILL)
        return pid

    def lupin(self, *arguments: str, bound_s: float = 60.0) -> subprocess.CompletedProcess[str]:
        """Another command of the same user."""
        return subprocess.run(
            [sys.executable, "-m", "lupin_cli.app", *arguments],
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=bound_s,
            check=False,
        )

    def children(self) -> list[psutil.Process]:
        """The processes of the run that live."""
        pids = [stage["pid"] for stage in self.state()["stages"] if stage["pid"] is not None]
        return [psutil.Process(pid) for pid in pids if psutil.pid_exists(pid)]

    def result(self, bound_s: float = 60.0) -> tuple[int, dict[str, Any]]:
        """Exit status and the JSON object of a run that was started with --json."""
        out, err = self.process.communicate(timeout=bound_s)
        assert out.strip(), err
        return self.process.returncode, json.loads(out)

    def end(self) -> None:
        """Whatever happened, leave nothing."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(10.0)
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()


@pytest.fixture
def launch(tmp_path: Path) -> Iterator[Callable[..., Up]]:
    """Start `lupin up` with arguments; ended with the test."""
    made: list[Up] = []

    def start(*arguments: str, prefix: tuple[str, ...] = ()) -> Up:
        made.append(Up(tmp_path, *arguments, prefix=prefix))
        return made[-1]

    yield start
    for one in made:
        one.end()
