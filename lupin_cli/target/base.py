"""What every target can do, in what words it fails. Nothing here knows SSH."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from lupin_cli.quick_dataclass import dataclass

ROOT_REFUSED = "root refused: "  # begins the standard error of a batch's root scripts where sudo refused; its reason follows


@dataclass(frozen=True)
class Script:
    """One POSIX-sh script of a batch: it reads nothing, and says what it has to say within `timeout_s`."""

    name: str
    text: str
    timeout_s: float = 5.0
    root: bool = False  # run through sudo where the user isn't root


@dataclass(frozen=True)
class Output:
    """What a script left. `status` is None where it was cut at its bound or the link went before it ended."""

    status: int | None
    stdout: str
    stderr: str = ""
    duration_s: float = 0.0
    truncated: bool = False  # more was printed than is kept

    @property
    def ok(self) -> bool:
        return self.status == 0


@dataclass(frozen=True)
class ClockReading:
    """What a machine's wall clock said, and between which instants of this one's it was read, ns since 1970."""

    sent_ns: int
    said: str  # seconds since 1970, with a fraction
    heard_ns: int


class Target(Protocol):
    """A machine to ask and to change. Every call is bounded and raises `TargetError` with the next command to type."""

    name: str  # the inventory's name of a robot, or "laptop"
    user: str

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        """Run all scripts side by side in one round trip; one output a script, by name, also where `bound_s` ended it."""

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        bound_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        """Run one script with standard input; `on_line` gets each line of its output as it comes."""

    def put(self, path: str, data: bytes, *, mode: int = 0o644, root: bool = False, bound_s: float = 60.0) -> None:
        """Write a file whole or not at all: a temporary one beside it, synced, then renamed over it."""

    def get(self, path: str, *, root: bool = False, bound_s: float = 60.0) -> bytes | None:
        """The bytes of a file; None where there is none."""

    def close(self) -> None:
        """Let the connection go. Calling it twice is fine."""


class TargetError(Exception):
    """What was expected of a target, what was found, and the next command to type."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


class Unreachable(TargetError):
    """No connection. `kind` says how it failed, since each way has its own cause."""

    def __init__(self, message: str, kind: str, next_command: str = "") -> None:
        super().__init__(message, next_command)
        self.kind = kind  # no-route | refused | timeout | silent (accepts, never answers) | name | lost


class HostKeyUnknown(TargetError):
    """The robot shows a key that nobody has accepted yet, and there is nobody to ask."""


class HostKeyChanged(TargetError):
    """The robot shows another key than the one that was accepted. Always fatal."""


class AuthenticationFailed(TargetError):
    """The robot knows the user's keys and password as little as the user."""


class RootRefused(TargetError):
    """sudo wants a password that wasn't given, or refuses this user."""
