"""`lupin up` as a child process of the test, with its own state folder."""

from __future__ import annotations

import fcntl
import json
import os
import pwd
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.graph_client import GraphClient
from tests.support.waiting import wait_until

UP_TIMEOUT_S = 240.0  # two engines, one after the other, may take 90 s each
CONSOLE_PORTS_TIMEOUT_S = 700.0


class Up:
    """A running `lupin up`."""

    def __init__(self, home: Path, *arguments: str, prefix: tuple[str, ...] = ()) -> None:
        self.home = home
        self.environment = {**os.environ, "XDG_STATE_HOME": str(home)}
        # Runs of other tests are up at the same time, and the console's ports exist only once on a machine.
        arguments = arguments if "--web" in arguments else (*arguments, "--no-web")
        # A pad of the machine that runs the tests must not drive.
        arguments = (*arguments, "--no-joystick")
        # A CI that was started by nohup ignores SIGHUP, and its children inherit that.
        command = [*prefix, "env", "--default-signal=HUP", sys.executable, "-m", "lupin_cli.app", "up", *arguments]
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

        def holds() -> dict[str, Any]:
            state = self.state()
            return state if state.get("stages") and condition(state) else {}

        state: dict[str, Any] = self.wait(holds, what, timeout_s)
        return state

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

        def value() -> Any:
            found = condition()
            assert found or self.process.poll() is None, f"exited while waiting for {what}: {self.process.communicate()}"
            return found

        return wait_until(
            value, lambda: f"{what}: {self.simulator()} {self.state()} {self.log('drive')[-1000:]}", timeout_s, interval_s=0.1
        )

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
        self.process.wait(60)
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


@pytest.fixture
def console_ports() -> Iterator[None]:
    """Wait until no other test on this machine uses the console's ports, of which there is one set."""

    def is_locked() -> bool:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    folder = Path(pwd.getpwuid(os.getuid()).pw_dir) / ".cache" / "lupin-tests"  # in /tmp another user could hold the lock
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    with (folder / "console-ports").open("w") as lock:
        wait_until(is_locked, "the console's ports, which another test uses", timeout_s=CONSOLE_PORTS_TIMEOUT_S, interval_s=1.0)
        yield


@pytest.fixture
def join() -> Iterator[Callable[[Up], GraphClient]]:
    """Join the graph of a run."""
    made: list[GraphClient] = []

    def observer(run: Up) -> GraphClient:
        folder = run.folder()
        assert folder is not None, "the run has not begun"
        made.append(GraphClient(folder, "observer"))
        made[-1].start()
        return made[-1]

    yield observer
    for one in made:
        one.close()


@pytest.fixture(scope="session")
def make_up() -> type[Up]:
    """Return the class Up, for tests that share a run; the caller ends the run."""
    return Up
