"""A ProxyCommand: a program whose standard streams lead to an sshd. The user's shell starts it, as with ssh."""

from __future__ import annotations

import contextlib
import os
import select
import shlex
import subprocess
import tempfile

import paramiko

from lupin_cli.connection.base import Unreachable
from lupin_cli.connection.destination import Destination

_NOT_STARTED = (126, 127)  # what a shell returns for a program that it cannot run, or does not find
_END_TIMEOUT_S = 1.0


class ProxyCommand(paramiko.ProxyCommand):
    """See `paramiko.ProxyCommand`, which needs no shell, and which waits for ever when the program has ended."""

    def __init__(self, name: str, destination: Destination) -> None:
        command, shell = destination.proxy_command, os.environ.get("SHELL") or "/bin/sh"
        self.cmd = [command]
        self.timeout: float | None = None
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 -- closed by terminate(); a pipe would fill
        try:
            self.process = subprocess.Popen(
                [shell, "-c", f"exec {command}"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                bufsize=0,
            )
        except OSError as error:
            self._errors.close()
            raise _unreachable(name, destination, "cannot be started", f"{shell}: {error.strerror}") from error

    def recv(self, size: int) -> bytes:
        """Return what has arrived; nothing at the end. Raises TimeoutError."""
        assert self.process.stdout is not None
        if not select.select([self.process.stdout], [], [], self.timeout)[0]:
            raise TimeoutError
        return os.read(self.process.stdout.fileno(), size)

    def close(self) -> None:
        """Ask the program to end."""
        if self.process.poll() is None:
            self.process.terminate()

    def failure(self, name: str, destination: Destination, detail: str) -> Unreachable:
        """Return the error for a login that failed behind this program: why, as it or the shell says."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(_END_TIMEOUT_S)
        status = self.process.poll()
        self._errors.seek(0)
        said = self._errors.read(4096).decode("utf-8", "replace").strip().splitlines()
        if status in _NOT_STARTED or not _is_quoted_well(destination.proxy_command):
            return _unreachable(name, destination, "cannot be started", said[-1] if said else detail)
        if status is not None:
            detail = f"it ended with status {status}"
        return _unreachable(name, destination, "does not work", ": ".join([detail, *said[-1:]]))

    def terminate(self) -> None:
        """End the program, and close its pipes."""
        self.close()
        try:
            self.process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(_END_TIMEOUT_S)
        for stream in (self.process.stdin, self.process.stdout, self._errors):
            if stream is not None:
                with contextlib.suppress(OSError):  # unsent bytes cannot be written any more
                    stream.close()


def _is_quoted_well(command: str) -> bool:
    try:
        shlex.split(command)
    except ValueError:
        return False
    return True


def _unreachable(name: str, destination: Destination, problem: str, detail: str) -> Unreachable:
    message = f"{name}: its ProxyCommand {problem}: {destination.proxy_command} ({detail})"
    return Unreachable(message, "jump", destination.login_command)
