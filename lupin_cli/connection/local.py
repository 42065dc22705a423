"""This machine as a target: in shells that this process starts; for sudo, with the same program that a robot gets."""

from __future__ import annotations

import contextlib
import os
import pwd
import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from lupin_cli.connection.base import Output, RootRefused, Script, TargetError
from lupin_cli.connection.batch_protocol import batch_program
from lupin_cli.connection.exec_stream import OutputCollector, run_program
from lupin_cli.connection.local_batch import run_in_parallel
from lupin_cli.connection.shell_file_io import decode_file, failure_reason, read_file_script, write_file_script

# The ROS wheels set these for their own processes; another program that inherits them loads the wheels' libraries.
_WHEEL_VARIABLES = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
_CHILD_SILENCE_S = 0.3  # after the script has exited: how long to wait for output of a child that kept its pipe


class LocalTarget:
    """The machine that Lupin runs on. `sudo_password` is for a user whose sudo needs one."""

    def __init__(self, name: str = "laptop", sudo_password: str | None = None) -> None:
        self.name = name
        self.address = "127.0.0.1"
        self.login_command = ""
        self.user = pwd.getpwuid(os.getuid()).pw_name
        self._sudo_password = sudo_password

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        """See `Target.batch`. If any script needs sudo, one program runs all of them, so that sudo runs once."""
        if os.geteuid() == 0 or not any(script.root for script in scripts):
            return run_in_parallel(scripts, timeout_s, _environment())
        program = batch_program(scripts, timeout_s, self._sudo_password)
        with _shell(program.command, program.payload) as process:
            for is_stderr, data in _read(process, time.monotonic() + timeout_s):
                if not is_stderr:
                    program.reader.feed(data)
                if program.reader.done:
                    break
        return program.reader.outputs(f"did not finish within {timeout_s:g} s")

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        timeout_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        """See `Target.run`."""
        program = run_program(script, root=root, stdin=stdin, timeout_s=timeout_s, sudo_password=self._sudo_password)
        collector = OutputCollector(program.mark, on_line)
        start = time.monotonic()
        with _shell(program.command, program.payload) as process:
            for is_stderr, data in _read(process, start + timeout_s):
                collector.feed(data, is_stderr)
            status = process.poll()
        if root and not collector.script_started and status is not None:
            reason = collector.last_error or "sudo printed nothing"
            raise RootRefused(f"{self.name}: {self.user} cannot run commands as root: {reason}", "sudo -v")
        return collector.output(status, time.monotonic() - start, timeout_s)

    def put(
        self, path: str, data: bytes, *, mode: int = 0o644, owner: str = "", root: bool = False, timeout_s: float = 60.0
    ) -> None:
        """See `Target.put`."""
        output = self.run(write_file_script(path, len(data), mode, owner), root=root, stdin=data, timeout_s=timeout_s)
        if not output.ok:
            raise TargetError(f"{self.name}: could not write {path}: {failure_reason(output)}; it is unchanged")

    def get(self, path: str, *, root: bool = False, timeout_s: float = 60.0) -> bytes | None:
        """See `Target.get`."""
        if not root or os.geteuid() == 0:
            try:
                return Path(path).expanduser().read_bytes()
            except FileNotFoundError:
                return None
            except OSError as error:
                raise TargetError(f"{self.name}: could not read {path}: {error.strerror}") from error
        return decode_file(self.name, path, self.run(read_file_script(path), root=True, timeout_s=timeout_s))

    def close(self) -> None:
        """See `Target.close`. There is nothing to close."""


def _environment() -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key not in _WHEEL_VARIABLES}


@contextlib.contextmanager
def _shell(command: str, payload: bytes) -> Iterator[subprocess.Popen[bytes]]:
    """Start a shell in its own process group with `payload` as standard input; terminate the group at the end of the block."""
    # A file instead of a pipe: it needs no thread that writes while the output is read.
    with _in_memory(payload) as stdin:
        process = subprocess.Popen(
            ["/bin/sh", "-c", command],
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=_environment(),
            process_group=0,  # not its own session: sudo remembers a password for the terminal that `sudo -v` ran on
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                with contextlib.suppress(ProcessLookupError, PermissionError):  # exited, or sudo, which its own `timeout` ends
                    os.killpg(process.pid, signal.SIGTERM)
                try:
                    process.wait(1.0)
                except subprocess.TimeoutExpired:
                    with contextlib.suppress(ProcessLookupError, PermissionError):
                        os.killpg(process.pid, signal.SIGKILL)
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        process.wait(1.0)
            for pipe in (process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()


@contextlib.contextmanager
def _in_memory(data: bytes) -> Iterator[int]:
    descriptor = os.memfd_create("lupin-stdin")
    try:
        view = memoryview(data)
        while view:
            view = view[os.write(descriptor, view) :]
        os.lseek(descriptor, 0, os.SEEK_SET)
        yield descriptor
    finally:
        os.close(descriptor)


def _read(process: subprocess.Popen[bytes], deadline: float) -> Iterator[tuple[bool, bytes]]:
    """Yield `(is_stderr, data)` until both streams end, the process has exited and its children are silent, or `deadline`."""
    assert process.stdout is not None and process.stderr is not None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ, False)
        selector.register(process.stderr, selectors.EVENT_READ, True)
        while selector.get_map() and (remaining_s := deadline - time.monotonic()) > 0:
            exited = process.poll() is not None
            ready = selector.select(min(remaining_s, _CHILD_SILENCE_S if exited else 0.2))
            if not ready:
                if exited:
                    return
                yield False, b""  # lets the caller check whether it has all it waits for
            for key, _ in ready:
                data = os.read(key.fd, 1 << 16)
                if data:
                    yield key.data, data
                else:
                    selector.unregister(key.fileobj)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(max(0.0, deadline - time.monotonic()))
