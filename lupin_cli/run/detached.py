"""A run in the background: it is started like one in the foreground, and followed until it is up or has ended."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE
from lupin_runtime.stack.runs import Run, live_runs

START_TIMEOUT_S = 20.0  # until the run exists
# Longer than the supervisor waits for the slowest process, after which it ends the run itself.
UP_TIMEOUT_S = 330.0
_POLL_S = 0.05


@dataclass(frozen=True)
class Started:
    """How a start in the background went. `text` says why `exit_status` is not 0."""

    child: subprocess.Popen[bytes]
    run: Run | None
    exit_status: int
    text: str = ""
    failed_process: str = ""  # its log says more
    up_after_s: float = 0.0
    processes: int = 0


def start(command: Sequence[str], show: Callable[[str], None]) -> Started:
    """Run `command`, which starts a run, in a new session; return once all needed processes are up or the run has ended.

    `show` gets lines of progress.
    """
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, start_new_session=True
        )
        deadline = time.monotonic() + START_TIMEOUT_S
        while (run := _run_of(child.pid)) is None:
            if child.poll() is not None:
                return Started(child, None, child.returncode or FAILURE, _text_of(errors) or "the run ended at once")
            if time.monotonic() > deadline:
                child.terminate()
                return Started(
                    child, None, UNREACHABLE, f"no run has started within {START_TIMEOUT_S:.0f} s\n{_text_of(errors)}"
                )
            time.sleep(_POLL_S)
        show(f"run {run.id} has started")
        started = _follow(run, child, show)
        return (
            started if started.text or not started.exit_status else Started(child, run, started.exit_status, _text_of(errors))
        )


def _follow(run: Run, child: subprocess.Popen[bytes], show: Callable[[str], None]) -> Started:
    deadline = time.monotonic() + UP_TIMEOUT_S
    shown: list[str] = []
    while True:
        has_exited = child.poll() is not None  # read before the state, whose last version is then the final one
        state = run.state()
        if isinstance(outcome := state.get("outcome"), dict):
            status = int(outcome.get("exit_status") or FAILURE)
            return Started(child, run, status, str(outcome.get("sentence", "")), str(outcome.get("failed_process", "")))
        if has_exited:
            return Started(child, run, child.returncode or FAILURE)
        stages = state.get("stages") or []
        up = [stage["name"] for stage in stages if stage["phase"] == "up"]
        if new := [name for name in up if name not in shown]:
            shown += new
            show(f"up: {', '.join(new)}")
        if stages and all(stage["phase"] == "up" or stage["optional"] for stage in stages):
            return Started(child, run, SUCCESS, up_after_s=_up_after_s(stages), processes=len(up))
        if time.monotonic() > deadline:
            missing = ", ".join(stage["name"] for stage in stages if stage["name"] not in up)
            return Started(child, run, UNREACHABLE, f"after {UP_TIMEOUT_S:.0f} s these are not up: {missing}; the run goes on")
        time.sleep(_POLL_S)


def _up_after_s(stages: Sequence[dict[str, Any]]) -> float:
    return max((float(stage["up_after_s"] or 0.0) for stage in stages), default=0.0)


def _run_of(pid: int) -> Run | None:
    """Return the live run that the process has started; None if there is none yet."""
    return next((run for run in live_runs() if run.info().get("pid") == pid), None)


def _text_of(errors: BinaryIO) -> str:
    errors.seek(0)
    return errors.read().decode(errors="replace").strip()
