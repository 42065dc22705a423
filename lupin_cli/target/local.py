"""This machine as a target: its own shells, and where sudo is needed the program that a robot gets."""

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

from lupin_cli.target.base import Output, RootRefused, Script, TargetError
from lupin_cli.target.files import get_program, put_program, read_get, reason_of_failure
from lupin_cli.target.framing import READ_BATCH, batch_program
from lupin_cli.target.side_by_side import side_by_side
from lupin_cli.target.streaming import Streams, run_program

# Set by the ROS wheels for their own processes; a foreign program that inherits them loads our libraries.
_WHEELS = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
_QUIET_S = 0.3  # after the program has ended: how long a child that kept its pipe may stay silent before nobody listens


class LocalTarget:
    """The machine that Lupin runs on. `sudo_password` is for a user whose sudo wants one."""

    def __init__(self, name: str = "laptop", sudo_password: str | None = None) -> None:
        self.name = name
        self.user = pwd.getpwuid(os.getuid()).pw_name
        self._sudo_password = sudo_password

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        """See `Target.batch`. Where sudo is needed it is asked once for all, by the program that a robot gets."""
        if os.geteuid() == 0 or not any(script.root for script in scripts):
            return side_by_side(scripts, bound_s, _environment())
        program = batch_program(scripts, bound_s, self._sudo_password)
        with _shell(READ_BATCH, program.payload) as process:
            for is_stderr, data in _read(process, time.monotonic() + bound_s):
                if not is_stderr:
                    program.reader.feed(data)
                if program.reader.done:
                    break
        return program.reader.outputs(f"no end within {bound_s:g} s")

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        bound_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        """See `Target.run`."""
        program = run_program(script, root=root, stdin=stdin, bound_s=bound_s, sudo_password=self._sudo_password)
        streams = Streams(program.mark, on_line)
        start = time.monotonic()
        with _shell(program.command, program.payload) as process:
            for is_stderr, data in _read(process, start + bound_s):
                streams.feed(data, is_stderr)
            status = process.poll()
        if root and not streams.marked and status is not None:
            raise RootRefused(
                f"{self.name}: root is refused to {self.user}: {streams.last_error or 'nothing was said'}", "sudo -v"
            )
        return streams.output(status, time.monotonic() - start, bound_s)

    def put(self, path: str, data: bytes, *, mode: int = 0o644, root: bool = False, bound_s: float = 60.0) -> None:
        """See `Target.put`."""
        output = self.run(put_program(path, len(data), mode), root=root, stdin=data, bound_s=bound_s)
        if not output.ok:
            raise TargetError(f"{self.name}: could not write {path}: {reason_of_failure(output)}; it is as it was")

    def get(self, path: str, *, root: bool = False, bound_s: float = 60.0) -> bytes | None:
        """See `Target.get`."""
        if not root or os.geteuid() == 0:
            try:
                return Path(path).expanduser().read_bytes()
            except FileNotFoundError:
                return None
            except OSError as error:
                raise TargetError(f"{self.name}: could not read {path}: {error.strerror}") from error
        return read_get(self.name, path, self.run(get_program(path), root=True, bound_s=bound_s))

    def close(self) -> None:
        """Nothing is held open."""


def _environment() -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key not in _WHEELS}


@contextlib.contextmanager
def _shell(command: str, payload: bytes) -> Iterator[subprocess.Popen[bytes]]:
    """A shell in a group of its own, with its payload at hand; whatever of it is left at the end is ended by that group."""
    # A file rather than a pipe: nobody has to keep writing while others are read.
    with _in_memory(payload) as stdin:
        process = subprocess.Popen(
            ["/bin/sh", "-c", command],
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=_environment(),
            process_group=0,  # but not a session: sudo remembers a password by the terminal that `sudo -v` was typed in
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                with contextlib.suppress(ProcessLookupError, PermissionError):  # gone meanwhile; sudo, which bounds itself
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
    """What comes on standard output (False) and error (True) until both end, or the process does and its heirs are silent."""
    assert process.stdout is not None and process.stderr is not None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ, False)
        selector.register(process.stderr, selectors.EVENT_READ, True)
        while selector.get_map() and (left := deadline - time.monotonic()) > 0:
            ended = process.poll() is not None
            ready = selector.select(min(left, _QUIET_S if ended else 0.2))
            if not ready:
                if ended:
                    return
                yield False, b""  # the reader may have waited long enough
            for key, _ in ready:
                data = os.read(key.fd, 1 << 16)
                if data:
                    yield key.data, data
                else:
                    selector.unregister(key.fileobj)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(max(0.0, deadline - time.monotonic()))
