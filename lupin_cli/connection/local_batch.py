"""Scripts in parallel on this machine, each in a shell that this process starts, reads and terminates itself.

`batch_protocol` lets the shell of another machine do the same. Without its helpers a script costs one process instead of nine.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from lupin_cli.connection.base import Output, Script
from lupin_cli.connection.batch_protocol import (
    ENVIRONMENT,
    EVALUATE,
    HELD_BY_STRAY,
    STDERR_COLUMNS,
    STDERR_LINES,
    STDOUT_CAP_BYTES,
    STRAY_GRACE_S,
    validate,
)

KILL_AFTER_S = 1.0  # from SIGTERM to SIGKILL, and from that to giving up
_TERMINATION_SIGNALS = (signal.SIGTERM, signal.SIGKILL)
_STDERR_CAP_BYTES = STDERR_LINES * STDERR_COLUMNS


def run_in_parallel(scripts: Sequence[Script], timeout_s: float, environment: Mapping[str, str]) -> dict[str, Output]:
    """Run `scripts` as this user, each bounded by its own timeout and by `timeout_s`. Return one output for each, by name.

    Raises ValueError like `batch_protocol.validate`.
    """
    validate(scripts)
    running: list[_RunningScript] = []
    with selectors.DefaultSelector() as selector:
        try:
            for script in scripts:
                running.append(_RunningScript(script, timeout_s, environment, selector))
            while unfinished := [each for each in running if not each.done]:
                wait_s = min(each.deadline_s for each in unfinished) - time.monotonic()
                for key, _ in selector.select(max(0.0, wait_s)):
                    key.data(key.fd)
                for each in unfinished:
                    each.enforce_deadline()
        finally:
            for each in running:
                each.close()
    return {each.script.name: each.output() for each in running}


@dataclass
class _CappedStream:
    """The beginning of a stream. Beyond the cap it is read and discarded, or closed if `close_at_cap`."""

    cap_bytes: int
    close_at_cap: bool
    data: bytearray = field(default_factory=bytearray)

    def add(self, data: bytes) -> bool:
        """Take the next bytes; return whether to read on."""
        self.data += data[: self.cap_bytes + 1 - len(self.data)]
        return bool(data) and not (self.close_at_cap and len(self.data) > self.cap_bytes)


class _RunningScript:
    """A script in its own process group, so that the background processes it leaves are terminated with it."""

    def __init__(
        self, script: Script, timeout_s: float, environment: Mapping[str, str], selector: selectors.BaseSelector
    ) -> None:
        self.script = script
        self._timeout_s = min(script.timeout_s, timeout_s)
        self._selector = selector
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", EVALUATE],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**environment, "lupin_script": ENVIRONMENT + script.text},
            process_group=0,  # not its own session: sudo remembers a password for the terminal that `sudo -v` ran on
        )
        assert self._process.stdout is not None and self._process.stderr is not None
        self._started_s = time.monotonic()
        self.deadline_s = self._started_s + self._timeout_s  # when `enforce_deadline` acts, unless the script has exited
        self._duration_s: float | None = None  # set when its shell has exited
        self._signals_sent = 0  # at its timeout and after it
        self._given_up = False  # a background process holds a pipe, or the kernel does not let the script exit
        self._stdout = _CappedStream(STDOUT_CAP_BYTES, close_at_cap=True)
        self._stderr = _CappedStream(_STDERR_CAP_BYTES, close_at_cap=False)
        streams = ((self._process.stdout, self._stdout), (self._process.stderr, self._stderr))
        self._open_pipes = {pipe.fileno(): (pipe, stream) for pipe, stream in streams}
        self._pidfd = os.pidfd_open(self._process.pid)
        for descriptor in self._open_pipes:
            selector.register(descriptor, selectors.EVENT_READ, self._read)
        selector.register(self._pidfd, selectors.EVENT_READ, self._handle_exit)

    @property
    def done(self) -> bool:
        """Whether there is nothing more to wait for."""
        return self._given_up or (self._duration_s is not None and not self._open_pipes)

    def _read(self, descriptor: int) -> None:
        pipe, stream = self._open_pipes[descriptor]
        if not stream.add(os.read(descriptor, 1 << 16)):
            self._selector.unregister(descriptor)
            del self._open_pipes[descriptor]
            pipe.close()

    def _handle_exit(self, _: int) -> None:
        self._selector.unregister(self._pidfd)
        self._signal_group(signal.SIGTERM)  # before wait(), after which the number may belong to another group
        self._process.wait()
        now_s = time.monotonic()
        self._duration_s, self.deadline_s = now_s - self._started_s, now_s + STRAY_GRACE_S

    def enforce_deadline(self) -> None:
        """Past the deadline, send SIGTERM, then SIGKILL, then give up; give up at once if only the pipes are still held."""
        if time.monotonic() < self.deadline_s or self.done:
            return
        if self._duration_s is None and self._signals_sent < len(_TERMINATION_SIGNALS):
            self._signal_group(_TERMINATION_SIGNALS[self._signals_sent])
            self._signals_sent += 1
            self.deadline_s = time.monotonic() + KILL_AFTER_S
        else:
            self._given_up = True

    def _signal_group(self, number: signal.Signals) -> None:
        try:
            os.killpg(self._process.pid, number)
        except (ProcessLookupError, PermissionError):  # exited, or sudo, which its own `timeout` ends
            return

    def close(self) -> None:
        """Terminate the script and close its descriptors. Background processes in their own sessions keep running."""
        if self._process.poll() is None:
            self._signal_group(signal.SIGKILL)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(KILL_AFTER_S)
        os.close(self._pidfd)
        for pipe, _ in self._open_pipes.values():
            pipe.close()

    def output(self) -> Output:
        """Return the script's output, after `close`."""
        lines = self._stderr.data.decode("utf-8", "backslashreplace").splitlines()[:STDERR_LINES]
        stderr = "\n".join(line[:STDERR_COLUMNS] for line in lines)
        status, timed_out = self._process.returncode, self._signals_sent > 0
        if timed_out:
            status, stderr = None, stderr or f"did not finish within {self._timeout_s:g} s"
        elif self._given_up:
            stderr = f"{stderr}\n{HELD_BY_STRAY}".lstrip()
        return Output(
            status if status is None or status >= 0 else 128 - status,
            self._stdout.data[:STDOUT_CAP_BYTES].decode("utf-8", "backslashreplace"),
            stderr,
            self._duration_s or 0.0,
            truncated=len(self._stdout.data) > STDOUT_CAP_BYTES or self._given_up or timed_out,
        )
