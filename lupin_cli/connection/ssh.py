"""A robot over SSH. One connection, opened on first use and again after it was lost; every wait on it has a time limit."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import paramiko

from lupin_cli.connection.base import (
    ClockReading,
    LoginShellUnusable,
    Output,
    RootRefused,
    Script,
    TargetError,
    Unreachable,
)
from lupin_cli.connection.batch_protocol import batch_program
from lupin_cli.connection.channel import CONNECTION_ERRORS, read_output, send_input
from lupin_cli.connection.connect import CONNECT_TIMEOUT_S, unreachable
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.exec_stream import OutputCollector, run_program
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.keepalive import ConnectionWatchdog
from lupin_cli.connection.login import HANDSHAKE_TIMEOUT_S, AskPassword, Connection
from lupin_cli.connection.sftp import Sftp
from lupin_cli.connection.shell_file_io import decode_file, failure_reason, read_file_script, write_file_script
from lupin_cli.printed_commands import complete


class SshTarget:
    """See `Target`. `ask_password` is None if nobody can be asked; `sudo_password` is for a user whose sudo needs one."""

    def __init__(
        self,
        name: str,
        destination: Destination,
        known_hosts: KnownHosts,
        *,
        transport_name: str = "",
        ask_password: AskPassword | None = None,
        sudo_password: str | None = None,
        connect_timeout_s: float = CONNECT_TIMEOUT_S,
    ) -> None:
        self.name = name
        self.user = destination.user
        self.address = destination.host
        self.login_command = destination.login_command
        self.destination = destination
        self.transport_name = transport_name  # in the inventory: wired, router or ap
        self.clock_reading: ClockReading | None = None  # of the last batch
        self._given_sudo_password = sudo_password
        self._connection = Connection(name, destination, known_hosts, ask_password, connect_timeout_s)
        self._sftp = Sftp()

    # -- the connection

    def connect(self) -> paramiko.Transport:
        """Return the live connection. Raises Unreachable, HostKeyUnknown, HostKeyChanged or AuthenticationFailed."""
        try:
            transport, is_new = self._connection.open()
        except TargetError as error:
            error.next_command = complete(error.next_command, robot=self.name)
            raise
        if is_new:
            self._sftp = Sftp()
        return transport

    def close(self) -> None:
        """See `Target.close`."""
        self._connection.close()

    @property
    def secrets(self) -> tuple[str, ...]:
        """The passwords that were given for this robot, to be masked in everything that is stored."""
        return tuple({*self._connection.passwords, *filter(None, [self._given_sudo_password])})

    @property
    def _sudo_password(self) -> str | None:
        """The sudo password; if none was given, the login password, which is the same by default."""
        return self._connection.password if self._given_sudo_password is None else self._given_sudo_password

    @property
    def peer(self) -> tuple[str, str]:
        """The addresses of the connection's two ends: the remote one, then this machine's.

        The remote end is the robot, or the first jump host. Raises TargetError behind a proxy command.
        """
        self.connect()
        first_socket = self._connection.first_socket
        if first_socket is None:
            raise TargetError(f"{self.name} is reached through a proxy command: this machine has no link to it to examine")
        return str(first_socket.getpeername()[0]), str(first_socket.getsockname()[0])

    # -- what a target can do

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        """See `Target.batch`. Raises Unreachable if the connection is lost before anything was received."""
        program = batch_program(scripts, timeout_s, self._sudo_password)
        deadline = time.monotonic() + timeout_s
        why_cut = f"did not finish within {timeout_s:g} s"
        shell_exited, last_error = False, ""
        self.clock_reading = None
        sent_ns = sent_monotonic_ns = 0
        with ConnectionWatchdog(self.connect(), timeout_s + 1.0) as watchdog:
            try:
                with _exec(watchdog.transport, program.command, timeout_s) as channel:
                    with contextlib.suppress(OSError):  # a shell that has exited takes no input; its output is still read
                        channel.sendall(program.payload[:-1])
                        # In this order: a pause between both makes the answer seem later, so that its bound stays true.
                        sent_monotonic_ns, sent_ns = time.monotonic_ns(), time.time_ns()
                        channel.sendall(program.payload[-1:])  # the program begins when its last byte has arrived
                        channel.shutdown_write()
                    while not program.reader.done and (remaining_s := deadline - time.monotonic()) > 0:
                        channel.settimeout(min(remaining_s, 0.5))
                        try:
                            data = channel.recv(1 << 16)
                        except TimeoutError:
                            continue
                        if not data:
                            shell_exited = True
                            break
                        program.reader.feed(data)
                    last_error = _last_error_line(channel)
            except CONNECTION_ERRORS as error:
                why_cut = f"the link was lost: {str(error) or type(error).__name__}"
            if not program.reader.done and time.monotonic() < deadline and _is_gone(watchdog.transport):
                why_cut = f"the link was lost: {watchdog.reason}"
                if not program.reader.started:
                    raise self._lost(watchdog.reason if watchdog.timed_out else "")
            elif shell_exited and not program.reader.started:
                raise self._shell_refused(last_error)
        if program.reader.clock is not None:
            text, received_ns = program.reader.clock
            self.clock_reading = ClockReading(sent_ns, text, sent_ns + received_ns - sent_monotonic_ns)
        return program.reader.outputs(why_cut)

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        timeout_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
        answers: Mapping[str, bytes] | None = None,
    ) -> Output:
        """See `Target.run`. When the script prints a line of `answers`, its standard input gets the answer, and not before."""
        program = run_program(script, root=root, stdin=stdin, timeout_s=timeout_s, sudo_password=self._sudo_password)

        def pass_on(line: str) -> None:
            if answers is not None and line in answers:
                channel.sendall(answers[line])
            elif on_line is not None:
                on_line(line)

        collector = OutputCollector(program.mark, pass_on if answers else on_line)
        status, lost = None, ""
        start = time.monotonic()
        with ConnectionWatchdog(self.connect(), timeout_s + 1.0) as watchdog:
            try:
                with _exec(watchdog.transport, program.command, timeout_s) as channel:
                    # On another thread, because the robot may stop reading until its own output is read.
                    sent = (channel, program.payload, not answers)
                    send = threading.Thread(target=send_input, args=sent, name="lupin-stdin", daemon=True)
                    send.start()
                    for is_stderr, data in read_output(channel, start + timeout_s):
                        collector.feed(data, is_stderr)
                    if channel.exit_status_ready() and channel.exit_status >= 0:
                        status = channel.exit_status
            except CONNECTION_ERRORS as error:
                lost = str(error) or type(error).__name__
            if status is None and time.monotonic() < start + timeout_s and _is_gone(watchdog.transport):
                lost = watchdog.reason if watchdog.timed_out else lost or watchdog.reason
        if status is not None and not collector.script_started:
            if root and collector.shell_started and collector.last_error:
                raise RootRefused(
                    f"{self.name}: {self.user} cannot run commands as root: {collector.last_error}",
                    f"lupin robots check {self.name} --ask-sudo-password",
                )
            raise self._shell_refused(collector.last_error)
        return collector.output(status, time.monotonic() - start, timeout_s, lost)

    def put(
        self, path: str, data: bytes, *, mode: int = 0o644, owner: str = "", root: bool = False, timeout_s: float = 60.0
    ) -> None:
        """See `Target.put`."""
        if not root and not owner:
            with ConnectionWatchdog(self.connect(), timeout_s + 1.0) as watchdog:
                if self._sftp.put(watchdog.transport, path, data, mode):
                    return
        # As root, or if SFTP is not served or reports no more than "Failure": a shell writes the file or says why not.
        output = self.run(write_file_script(path, len(data), mode, owner), root=root, stdin=data, timeout_s=timeout_s)
        if not output.ok:
            self._require_link(output, f"{path} is unchanged or complete")
            raise TargetError(f"{self.name}: could not write {path}: {failure_reason(output)}; it is unchanged")

    def get(self, path: str, *, root: bool = False, timeout_s: float = 60.0) -> bytes | None:
        """See `Target.get`."""
        output = self.run(read_file_script(path), root=root, timeout_s=timeout_s)
        self._require_link(output, f"while {path} was read")
        return decode_file(self.name, path, output)

    def open_run(self, script: str, timeout_s: float) -> paramiko.Channel:
        """Start `script` and return its channel, for exchanges in both directions. The caller closes it. Raises Unreachable."""
        program = run_program(script, root=False, stdin=b"", timeout_s=timeout_s, sudo_password=None)
        try:
            channel = self.connect().open_session(timeout=min(timeout_s, HANDSHAKE_TIMEOUT_S))
            channel.settimeout(timeout_s)
            channel.exec_command(program.command)
            channel.sendall(program.payload)
            received = bytearray()
            while not received.endswith(program.mark + b"\n"):  # byte by byte: what follows the mark belongs to the caller
                if not (byte := channel.recv(1)):
                    raise EOFError("the script did not start")
                received += byte
        except CONNECTION_ERRORS as error:
            raise self._lost(str(error)) from error
        return channel

    def _require_link(self, output: Output, detail: str) -> None:
        """Raise Unreachable if a script did not finish because the connection was lost."""
        if output.status is None and self._connection.live is None:
            raise self._lost(detail)

    def _lost(self, detail: str) -> Unreachable:
        error = unreachable(str(self.destination), "lost", detail)
        error.next_command = complete(error.next_command, robot=self.name)
        return error

    def _shell_refused(self, last_line: str) -> LoginShellUnusable:
        """Return the error for a login shell that ran no command: a startup file replaces it, or the user has no shell."""
        return LoginShellUnusable(
            f"{self.name}: the login shell of {self.user} does not run commands; it printed: {last_line or 'nothing'}. "
            "A startup file that ends with 'exec ...' must do so on terminals only: [ -t 0 ] && exec ...",
            f"{self.login_command} 'echo fine'",
        )


@contextlib.contextmanager
def _exec(transport: paramiko.Transport, command: str, timeout_s: float) -> Iterator[paramiko.Channel]:
    """Yield a channel on which `command` runs; close it at the end."""
    channel = transport.open_session(timeout=min(timeout_s, HANDSHAKE_TIMEOUT_S))
    try:
        channel.settimeout(timeout_s)
        channel.exec_command(command)
        yield channel
    finally:
        channel.close()


def _is_gone(transport: paramiko.Transport, grace_s: float = 0.2) -> bool:
    """Return whether the connection is closed too, after a channel was: paramiko closes channels a moment earlier."""
    transport.join(grace_s)
    return not transport.is_active()


def _last_error_line(channel: paramiko.Channel) -> str:
    """Return the last line of standard error that has arrived."""
    data = channel.recv_stderr(1 << 16) if channel.recv_stderr_ready() else b""
    return ["", *data.decode("utf-8", "replace").strip().splitlines()][-1]
