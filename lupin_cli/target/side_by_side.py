"""Scripts side by side on this machine, each in a shell that this process starts, reads and ends itself.

What `framing` does where another machine's shell has to: without its helpers a script costs one process here instead of nine.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import field

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output, Script
from lupin_cli.target.framing import (
    ENVIRONMENT,
    STDERR_COLUMNS,
    STDERR_LINES,
    STDOUT_CAP_BYTES,
    STRAY_GRACE_S,
    require_fit,
)

KILL_AFTER_S = 1.0  # from SIGTERM to SIGKILL, and from that to giving up
_WAYS_TO_END = (signal.SIGTERM, signal.SIGKILL)
_STDERR_CAP_BYTES = STDERR_LINES * STDERR_COLUMNS


def side_by_side(scripts: Sequence[Script], bound_s: float, environment: Mapping[str, str]) -> dict[str, Output]:
    """Run `scripts` at once as this user, each bounded by its own time-out and by `bound_s`; one output a script, by name.

    Raises ValueError for two scripts of one name or a script that no argument can hold.
    """
    require_fit(scripts)
    runs: list[_Run] = []
    with selectors.DefaultSelector() as selector:
        try:
            for script in scripts:
                runs.append(_Run(script, bound_s, environment, selector))
            while left := [run for run in runs if not run.done]:
                for key, _ in selector.select(max(0.0, min(run.due_s for run in left) - time.monotonic())):
                    key.data(key.fd)
                for run in left:
                    run.attend()
        finally:
            for run in runs:
                run.leave()
    return {run.script.name: run.output() for run in runs}


@dataclass
class _Kept:
    """The beginning of a stream. What comes after it is read and passed over, or else the stream is `cut` there."""

    cap_bytes: int
    cut: bool
    data: bytearray = field(default_factory=bytearray)

    def take(self, data: bytes) -> bool:
        """Whether the stream goes on."""
        self.data += data[: self.cap_bytes + 1 - len(self.data)]
        return bool(data) and not (self.cut and len(self.data) > self.cap_bytes)


class _Run:
    """One script under way. What it leaves in the background is of its group, and is ended with it."""

    def __init__(
        self, script: Script, bound_s: float, environment: Mapping[str, str], selector: selectors.BaseSelector
    ) -> None:
        self.script = script
        self._bound_s = min(script.timeout_s, bound_s)
        self._selector = selector
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", ENVIRONMENT + script.text],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
            process_group=0,  # but not a session: sudo remembers a password by the terminal that `sudo -v` was typed in
        )
        assert self._process.stdout is not None and self._process.stderr is not None
        self._began_s = time.monotonic()
        self.due_s = self._began_s + self._bound_s  # when something is to be done about it, unless its end comes before
        self._duration_s: float | None = None  # once its shell has ended
        self._asked_to_end = 0  # times, at its bound and after it
        self._stray = False
        self._stdout, self._stderr = _Kept(STDOUT_CAP_BYTES, cut=True), _Kept(_STDERR_CAP_BYTES, cut=False)
        streams = ((self._process.stdout, self._stdout), (self._process.stderr, self._stderr))
        self._open = {pipe.fileno(): (pipe, kept) for pipe, kept in streams}
        self._end = os.pidfd_open(self._process.pid)
        for number in self._open:
            selector.register(number, selectors.EVENT_READ, self._hear)
        selector.register(self._end, selectors.EVENT_READ, self._ended)

    @property
    def done(self) -> bool:
        """Whether nothing more is waited for."""
        return self._stray or (self._duration_s is not None and not self._open)

    def _hear(self, number: int) -> None:
        pipe, kept = self._open[number]
        if not kept.take(os.read(number, 1 << 16)):
            self._selector.unregister(number)
            del self._open[number]
            pipe.close()

    def _ended(self, _: int) -> None:
        self._selector.unregister(self._end)
        self._signal(signal.SIGTERM)  # as long as nobody else can have its number
        self._process.wait()
        now_s = time.monotonic()
        self._duration_s, self.due_s = now_s - self._began_s, now_s + STRAY_GRACE_S

    def attend(self) -> None:
        """At its bound ask it to end, and a moment later don't ask. Neither a stray that holds its pipes nor a kernel that does
        not let it end is waited for much longer."""
        if time.monotonic() < self.due_s or self.done:
            return
        if self._duration_s is None and self._asked_to_end < len(_WAYS_TO_END):
            self._signal(_WAYS_TO_END[self._asked_to_end])
            self._asked_to_end += 1
            self.due_s = time.monotonic() + KILL_AFTER_S
        else:
            self._stray = True

    def _signal(self, number: signal.Signals) -> None:
        try:
            os.killpg(self._process.pid, number)
        except (ProcessLookupError, PermissionError):  # gone meanwhile; sudo, which is bounded by whoever called it
            return

    def leave(self) -> None:
        """Nothing of it runs on, and nothing is open; a stray in a session of its own keeps what it holds."""
        if self._process.poll() is None:
            self._signal(signal.SIGKILL)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(KILL_AFTER_S)
        os.close(self._end)
        for pipe, _ in self._open.values():
            pipe.close()

    def output(self) -> Output:
        """What came of it."""
        lines = self._stderr.data.decode("utf-8", "backslashreplace").splitlines()[:STDERR_LINES]
        stderr = "\n".join(line[:STDERR_COLUMNS] for line in lines)
        status, cut = self._process.returncode, self._asked_to_end > 0
        if cut:
            status, stderr = None, stderr or f"no end within {self._bound_s:g} s"
        elif self._stray:
            stderr = (stderr + "\na process that it left behind holds its output").lstrip()
        return Output(
            status if status is None or status >= 0 else 128 - status,
            self._stdout.data[:STDOUT_CAP_BYTES].decode("utf-8", "backslashreplace"),
            stderr,
            self._duration_s or 0.0,
            truncated=len(self._stdout.data) > STDOUT_CAP_BYTES or self._stray or cut,
        )
