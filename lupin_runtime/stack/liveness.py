"""Detects hung and exited processes, and blocks robot motion until they are replaced.

Every process sends heartbeats (`lupin_runtime.heartbeat`). A thread of the supervisor receives and judges them, so that
neither a slow disk nor a long repaint of the live view in the main loop looks like a hang.

A busy machine is not a hang. While a silent process waits for CPU or disk, only its CPU time counts as silence. Regardless of
load, motion is blocked after 2 s and the process is replaced after 10 s of wall-clock silence. Times in which this thread
itself did not run, as on a suspended computer, count for no process.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from lupin_runtime.heartbeat import MAX_BYTES, SUPERVISOR_PERIOD_S, Beat, decode, encode
from lupin_runtime.stack.usage import Activity, activity

# Seconds of silence as defined above, and of wall-clock silence, after which nothing may move and the process is replaced.
MOTION_BLOCK_AFTER_S, REPLACE_AFTER_S = 0.5, 2.0
MOTION_BLOCK_WALL_S, REPLACE_WALL_S = 2.0, 10.0
# Deadline for the first heartbeat after readiness: on a busy machine the process's other nodes may still be starting.
FIRST_BEAT_S = 5.0
EXAMINE_AFTER_S = 0.35  # for shorter silences /proc is not read
OWN_STALL_S = 1.0  # a longer gap between two rounds of this thread is excused for all processes
MAIN_LOOP_S = 3.0
SUPERVISOR = "the supervisor's main loop"
SILENT, EXITED, RESTARTING = "does not respond", "has exited", "is being restarted"


@dataclass(frozen=True)
class Silence:
    """How long a process has been silent: by the rules of this module, and by the wall clock. `node` is its slowest node."""

    counted_s: float
    wall_s: float
    node: str = ""

    @property
    def blocks_motion(self) -> bool:
        """Whether nothing may move."""
        return self.counted_s >= MOTION_BLOCK_AFTER_S or self.wall_s >= MOTION_BLOCK_WALL_S

    @property
    def hung(self) -> bool:
        """Whether the process must be replaced."""
        return self.counted_s >= REPLACE_AFTER_S or self.wall_s >= REPLACE_WALL_S


NO_SILENCE = Silence(0.0, 0.0)


@dataclass
class HeartbeatRecord:
    """The last heartbeat of one process, and its silence since then. Times are nanoseconds of CLOCK_MONOTONIC."""

    read_activity: Callable[[], Activity | None]
    beat: Beat | None = None
    first_due_ns: int | None = None  # when the first heartbeat is due; None while the process is starting
    _counted_s: float = 0.0
    _judged_ns: int = 0
    _since_ns: int = 0
    _last: Activity | None = field(default=None, repr=False)

    def silence(self, now_ns: int, ignore_before_ns: int = 0) -> Silence:
        """Return the silence up to now; time before `ignore_before_ns` does not count. Call it every SUPERVISOR_PERIOD_S."""
        heard_ns = self.first_due_ns if self.beat is None else self.beat.time_ns
        if heard_ns is None:
            return NO_SILENCE
        since_ns = max(heard_ns, ignore_before_ns)
        wall_s = max(0.0, (now_ns - since_ns) / 1e9)
        if wall_s < EXAMINE_AFTER_S or since_ns != self._since_ns:
            self._counted_s, self._last = wall_s, None
        else:
            self._counted_s += self._interval_s(now_ns)
        self._since_ns, self._judged_ns = since_ns, now_ns
        return Silence(self._counted_s, wall_s, self.beat.text if self.beat else "")

    def _interval_s(self, now_ns: int) -> float:
        """Return the part of the time since the last call that counts as silence."""
        interval_s = (now_ns - self._judged_ns) / 1e9
        before, self._last = self._last, self.read_activity()
        if before is None or self._last is None or not self._last.waiting:
            return interval_s
        return min(interval_s, max(0.0, self._last.cpu_s - before.cpu_s))


@dataclass
class _MonitoredProcess:
    """A process, by the supervisor's end of its standard input and by its heartbeats."""

    socket: socket.socket
    record: HeartbeatRecord
    commands_motion: bool
    may_block_motion: bool
    is_replacement: bool = False  # whether it replaces a process that had sent heartbeats
    exited: bool = False

    def motion_block_reason(self, silence: Silence) -> str:
        """Return why nothing may move because of this process; empty if it responds, or has not come up yet."""
        if not self.may_block_motion:
            return ""
        if self.exited:
            return EXITED if self.is_replacement or self.record.beat is not None else ""
        if self.record.beat is None and self.is_replacement:
            return RESTARTING
        return SILENT if silence.blocks_motion else ""


class Liveness:
    """Receives the heartbeats of all processes and judges them in its own thread."""

    def __init__(self) -> None:
        self._processes: dict[str, _MonitoredProcess] = {}
        self._lock = threading.Lock()
        self._silences: dict[str, Silence] = {}
        self._main_loop_ns = time.monotonic_ns()
        self._ignore_before_ns = 0
        self._judged_ns: int | None = None
        self._closed = threading.Event()
        self._hangup_poll = select.poll()
        self._thread = threading.Thread(target=self._run, name="liveness", daemon=True)

    def start(self) -> None:
        """Start the thread that receives and judges heartbeats."""
        self._thread.start()

    def close(self) -> None:
        """Stop monitoring. The sockets stay open: closing one makes its process exit."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def has_failed(self) -> bool:
        """Whether the thread has ended by itself: processes that command motion then stop it, and no hang is noticed."""
        return self._thread.ident is not None and not self._thread.is_alive() and not self._closed.is_set()

    def monitor(
        self, name: str, pid: int, channel: socket.socket, commands_motion: bool, may_block_motion: bool = True
    ) -> None:
        """Monitor a process that was just started, whose standard input is the other end of `channel`.

        Nothing moves while it has exited, is restarted or is silent, if it `may_block_motion`.
        """
        channel.setblocking(False)
        with self._lock:
            before = self._processes.get(name)
            is_replacement = before is not None and (before.is_replacement or before.record.beat is not None)
            self._drop(name)
            record = HeartbeatRecord(lambda: activity(pid))
            self._processes[name] = _MonitoredProcess(channel, record, commands_motion, may_block_motion, is_replacement)
            self._hangup_poll.register(channel, 0)  # event mask 0: poll() reports only POLLHUP and POLLERR

    def expect_heartbeats(self, name: str) -> None:
        """Expect heartbeats from a process that is up: without any within FIRST_BEAT_S it counts as silent."""
        with self._lock:
            process = self._processes.get(name)
            if process is not None:
                process.record.first_due_ns = time.monotonic_ns() + int(FIRST_BEAT_S * 1e9)

    def stop_monitoring(self, name: str) -> None:
        """Drop a process that has exited and is not replaced, and close its socket."""
        with self._lock:
            self._drop(name)

    def record_main_loop_iteration(self) -> None:
        """Record an iteration of the supervisor's main loop: if the loop hangs, nothing may move."""
        self._main_loop_ns = time.monotonic_ns()

    def responds(self, name: str) -> bool:
        """Return whether a process has sent heartbeats and is not silent."""
        with self._lock:
            process = self._processes.get(name)
            return process is not None and process.record.beat is not None and not self._motion_block_reason(name)

    def motion_block_reasons(self) -> dict[str, str]:
        """Return the processes because of which nothing may move now, each with what is wrong."""
        with self._lock:
            reasons = {name: self._motion_block_reason(name) for name in self._processes}
        return {name: reason for name, reason in reasons.items() if reason}

    def hung(self) -> dict[str, Silence]:
        """Return the processes that must be replaced because they do not respond."""
        with self._lock:
            return {name: silence for name, silence in self._silences.items() if silence.hung}

    def _motion_block_reason(self, name: str) -> str:
        return self._processes[name].motion_block_reason(self._silences.get(name, NO_SILENCE))

    def _drop(self, name: str) -> None:
        process = self._processes.pop(name, None)
        self._silences.pop(name, None)
        if process is not None:
            if not process.exited:
                self._hangup_poll.unregister(process.socket)
            process.socket.close()

    def _run(self) -> None:
        while not self._closed.is_set():
            self._hangup_poll.poll(SUPERVISOR_PERIOD_S * 1e3)
            with self._lock:
                # Polled again: meanwhile a process may have been replaced by one whose socket has the same descriptor.
                self._judge({descriptor for descriptor, _ in self._hangup_poll.poll(0)})

    def _judge(self, hung_up: set[int]) -> None:
        for process in self._processes.values():
            process.record.beat = _newest(process.socket) or process.record.beat
            if process.socket.fileno() in hung_up:
                process.exited = True
                self._hangup_poll.unregister(process.socket)
        now_ns = time.monotonic_ns()
        if self._judged_ns is not None and now_ns - self._judged_ns > OWN_STALL_S * 1e9:
            self._ignore_before_ns = now_ns
        self._judged_ns = now_ns
        self._silences = {
            name: process.record.silence(now_ns, self._ignore_before_ns)
            for name, process in self._processes.items()
            if not process.exited
        }
        reasons = [f"{name} {reason}" for name in self._processes if (reason := self._motion_block_reason(name))]
        if now_ns - max(self._main_loop_ns, self._ignore_before_ns) > MAIN_LOOP_S * 1e9:
            reasons.append(f"{SUPERVISOR} {SILENT}")
        packet = encode(Beat(now_ns, ", ".join(reasons)))
        for process in self._processes.values():
            if process.commands_motion:
                _send(process.socket, packet)


def _newest(channel: socket.socket) -> Beat | None:
    newest = None
    with contextlib.suppress(OSError):  # everything is read, or the process has exited
        while packet := channel.recv(MAX_BYTES):
            newest = decode(packet) or newest
    return newest


def _send(channel: socket.socket, packet: bytes) -> None:
    with contextlib.suppress(OSError):  # buffer full or process gone: both detected elsewhere
        channel.send(packet)
