"""The `Target` protocol: what a command can do with a machine, and the errors it can raise. Nothing here depends on SSH."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

# If sudo refuses, the root scripts of a batch do not run. Their standard error starts with this, and sudo's reason follows.
ROOT_REFUSED = "root refused: "


@dataclass(frozen=True)
class Script:
    """One POSIX-sh script of a batch. It gets no input and is terminated after `timeout_s`."""

    name: str
    text: str
    timeout_s: float = 5.0
    root: bool = False  # run it through sudo unless the user is root


@dataclass(frozen=True)
class Output:
    """The output of a script. `status` is None if it was terminated at its timeout or the connection was lost."""

    status: int | None
    stdout: str
    stderr: str = ""
    duration_s: float = 0.0
    truncated: bool = False  # the script printed more than is kept

    @property
    def ok(self) -> bool:
        """Whether the script exited with status 0."""
        return self.status == 0


@dataclass(frozen=True)
class ClockReading:
    """A reading of a machine's wall clock, between two instants of this machine's wall clock, in ns since 1970."""

    sent_ns: int
    text: str  # seconds since 1970 with a fraction, as the machine printed them
    received_ns: int


class Target(Protocol):
    """A machine that a command acts on. Every call has a time limit, and raises `TargetError` with the next command to type."""

    name: str  # the robot's name in the inventory, or "laptop"
    user: str
    address: str  # the host name or address by which this machine reaches it
    login_command: str  # what a person types to get a shell there, such as "ssh mirte@10.42.0.1"; empty for this machine

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        """Run all scripts in parallel in one round trip. Return an output for each, by name, even if it was cut off."""

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        timeout_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        """Run one script with standard input. `on_line` gets each line of its output as it is printed."""

    def put(
        self, path: str, data: bytes, *, mode: int = 0o644, owner: str = "", root: bool = False, timeout_s: float = 60.0
    ) -> None:
        """Write a file atomically: a temporary file in the same directory, synced, then renamed. `owner` is user:group."""

    def get(self, path: str, *, root: bool = False, timeout_s: float = 60.0) -> bytes | None:
        """Return the content of a file, or None if it does not exist."""

    def close(self) -> None:
        """Close the connection. A second call does nothing."""


class TargetError(Exception):
    """A target did not do what was asked. The message says what was expected and found, `next_command` what to type."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


class Unreachable(TargetError):
    """There is no connection to the target. `kind` says how connecting failed, because each kind has its own causes."""

    def __init__(self, message: str, kind: str, next_command: str = "") -> None:
        super().__init__(message, next_command)
        # no-route | refused | timeout | silent (accepts a connection, never answers) | name | lost | jump (a host on the way)
        self.kind = kind


class HostKeyUnknown(TargetError):
    """The robot's host key was not accepted: a person declined it, or there was nobody to ask."""


class HostKeyChanged(TargetError):
    """The robot's host key differs from the accepted one. Always fatal."""


class AuthenticationFailed(TargetError):
    """The robot accepts neither the user's keys nor a password."""


class PrivateKeyUnusable(AuthenticationFailed):
    """A private key of this user cannot be read, and no other one is accepted."""


class PrivateKeyMissing(AuthenticationFailed):
    """This user has no private key at all."""


class SshConfigUnusable(TargetError):
    """The user's ~/.ssh/config cannot be read, or applied to the host."""


class LoginShellUnusable(TargetError):
    """The login works, and the user's login shell runs no command."""


class RootRefused(TargetError):
    """sudo needs a password that was not given, or refuses this user."""
