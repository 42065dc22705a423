"""How a command reaches the machine that it acts on: a robot over SSH, or this machine. Both are a `Target`."""

from lupin_cli.connection.base import (
    AuthenticationFailed,
    HostKeyChanged,
    HostKeyUnknown,
    Output,
    RootRefused,
    Script,
    Target,
    TargetError,
    Unreachable,
)

__all__ = [
    "AuthenticationFailed",
    "HostKeyChanged",
    "HostKeyUnknown",
    "Output",
    "RootRefused",
    "Script",
    "Target",
    "TargetError",
    "Unreachable",
]
