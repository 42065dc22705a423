"""The service of the robot's processes: when systemd's watchdog is notified."""

from __future__ import annotations

import errno
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.stack import service
from lupin_runtime.stack import supervisor as supervisor_module
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.readiness import Readiness
from lupin_runtime.stack.runs import Run, create_run
from lupin_runtime.stack.supervisor import Supervisor
from lupin_runtime.stack.table import ProcessRow

BEATING = (
    "import time; from lupin_runtime.ros.supervision import Supervision\n"
    "channel = Supervision(); channel.start()\n"
    "while True:\n    channel.beat(time.monotonic_ns(), 'node'); time.sleep(0.1)"
)


class FakeNotifier:
    """Counts what the service would tell systemd."""

    def __init__(self) -> None:
        self.is_ready = False
        self.alive_count = 0

    def ready(self) -> None:
        self.is_ready = True

    def alive(self) -> None:
        self.alive_count += 1

    def status(self, text: str) -> None:
        """Ignore the line for `systemctl status`."""


class FakeMonitor:
    """A graph on which every condition holds; instead of spinning it continues the test."""

    alarms: tuple[str, ...] = ()

    def __init__(self, script: Iterator[None]) -> None:
        self._script = script

    def spin(self, _: float) -> None:
        time.sleep(0.02)
        next(self._script)

    def satisfied(self, _: Readiness) -> bool:
        return True

    def forget(self, _: Readiness) -> None:
        """Remember nothing."""

    def explain(self, condition: Readiness) -> str:
        return str(condition)


def row(name: str, watched: bool) -> ProcessRow:
    return ProcessRow(name, command=lambda _: ["-c", BEATING], watched=watched)


@pytest.fixture
def supervise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Run the service with the processes `estop`, `drive` (both watched) and `body`; its loop executes a script of the test."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    rows = (row("estop", True), row("drive", True), row("body", False))
    monkeypatch.setattr(supervisor_module, "rows", lambda _: rows)
    # A hung process is not replaced here, so that the test decides how long it hangs.
    monkeypatch.setattr(Supervisor, "_kill", staticmethod(lambda *_: None))
    run, lock = create_run()
    made: list[Supervisor] = []

    def start(script: Callable[[Supervisor, FakeNotifier], Iterator[None]]) -> None:
        notifier, stop = FakeNotifier(), list[int]()

        def steps() -> Iterator[None]:
            yield from script(supervisor, notifier)
            stop.append(signal.SIGTERM)
            yield

        monitor: Any = FakeMonitor(steps())
        supervisor = Supervisor(Options(run_path=run.path), run, dict(os.environ), monitor, own_output=True)
        made.append(supervisor)
        service._supervise(supervisor, monitor, notifier, run, stop)  # type: ignore[arg-type]

    yield start
    for supervisor in made:
        supervisor.stop()
    os.close(lock)


def until(condition: Callable[[], bool]) -> Iterator[None]:
    while not condition():
        yield


@pytest.mark.parametrize(("name", "is_watched"), [("estop", True), ("drive", True), ("body", False)])
def test_watchdog_is_notified_while_estop_and_drive_respond(
    supervise: Callable[..., None], name: str, is_watched: bool
) -> None:
    finished: list[bool] = []

    def script(supervisor: Supervisor, notifier: FakeNotifier) -> Iterator[None]:
        yield from until(lambda: notifier.is_ready and all(map(supervisor.liveness.responds, ("estop", "drive", "body"))))
        count = notifier.alive_count
        yield from until(lambda: notifier.alive_count > count + 5)
        stage = supervisor.stage(name)
        assert stage is not None and stage.process is not None
        os.kill(stage.process.pid, signal.SIGSTOP)
        yield from until(lambda: not supervisor.liveness.responds(name))
        count = notifier.alive_count
        for _ in range(50):
            yield
        assert (notifier.alive_count <= count + 1) == is_watched
        os.kill(stage.process.pid, signal.SIGCONT)
        yield from until(lambda: supervisor.liveness.responds(name))
        count = notifier.alive_count
        yield from until(lambda: notifier.alive_count > count + 5)
        finished.append(True)

    supervise(script)
    assert finished


def test_full_disk_does_not_end_the_service(
    supervise: Callable[..., None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    writes: list[int] = []

    def write_state(*_: object) -> None:
        writes.append(1)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Run, "write_state", write_state)
    monkeypatch.setattr(service, "STATE_PERIOD_S", 0.0)

    def script(supervisor: Supervisor, _: FakeNotifier) -> Iterator[None]:
        yield from until(lambda: supervisor.all_up() and len(writes) > 3)

    supervise(script)
    assert capsys.readouterr().err.count("No space left on device") == 1


def test_watchdog_is_notified_before_the_service_is_ready(supervise: Callable[..., None]) -> None:
    counts: list[int] = []

    def script(_: Supervisor, notifier: FakeNotifier) -> Iterator[None]:
        yield
        counts.append(notifier.alive_count)
        yield

    supervise(script)
    assert counts[0] > 0, "a slow start is limited by TimeoutStartSec"
