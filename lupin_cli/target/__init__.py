"""Where a command acts: a robot over SSH, or this machine. One small protocol serves both."""

from lupin_cli.target import lean  # noqa: F401 -- before anything here imports paramiko
from lupin_cli.target.base import (
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
