"""Heartbeats between the supervisor and its processes, one packet each, over the socket that is a process's standard input.

A process sends the time up to which all its nodes handled their events, with the name of the slowest. To the processes that
command motion the supervisor sends its own time, with the reason why nothing may move now, or an empty text. Both times are
CLOCK_MONOTONIC, which a step of the wall clock and a suspended computer do not change.
"""

from __future__ import annotations

from typing import NamedTuple

PROCESS_PERIOD_S = 0.25
SUPERVISOR_PERIOD_S = 0.2
# A process that commands motion stops it once its supervisor has been silent for this long.
SUPERVISOR_TIMEOUT_S = 0.6
MAX_BYTES = 1024


class Beat(NamedTuple):
    """A heartbeat: nanoseconds of CLOCK_MONOTONIC, and a text."""

    time_ns: int
    text: str = ""


def names_process(reason: str, process: str) -> bool:
    """Return whether the supervisor's reason why nothing may move names this process."""
    return any(part.startswith(f"{process} ") for part in reason.split(", "))


def encode(beat: Beat) -> bytes:
    """Return the packet of a heartbeat; never empty, because an empty packet means the end of the channel."""
    return f"{beat.time_ns} {beat.text}".encode()[:MAX_BYTES]


def decode(packet: bytes) -> Beat | None:
    """Return the heartbeat in a packet, or None if it is not one."""
    time_ns, _, text = packet.decode(errors="replace").partition(" ")
    return Beat(int(time_ns), text) if time_ns.isascii() and time_ns.isdigit() else None
