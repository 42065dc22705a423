"""A robot over SSH. One connection, opened when it is first needed and again after it was lost; every wait on it is bounded."""

from __future__ import annotations

import contextlib
import logging
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import paramiko

from lupin_cli.target.base import AuthenticationFailed, ClockReading, Output, RootRefused, Script, TargetError
from lupin_cli.target.channel import LOST, read, send
from lupin_cli.target.destination import Destination
from lupin_cli.target.files import get_program, put_program, read_get, reason_of_failure
from lupin_cli.target.framing import READ_BATCH, batch_program
from lupin_cli.target.keepalive import Watch
from lupin_cli.target.reach import CONNECT_TIMEOUT_S, Knock, open_greeted, unreachable
from lupin_cli.target.sftp import Sftp
from lupin_cli.target.streaming import Streams, run_program
from lupin_cli.target.trust import Trust

logging.getLogger("paramiko").setLevel(logging.CRITICAL)  # its threads print stacks of what is reported here in one line

AskPassword = Callable[[str], str]

_KEEPALIVE_S = 5  # between calls too: a way that died is then known before the next one
_HANDSHAKE_S = 10.0  # key exchange on a robot that is busy booting


class SshTarget:
    """See `Target`. `ask_password` is None where nobody can be asked; `sudo_password` is for a user whose sudo wants one;
    `knock` is for the first connection, where somebody has knocked already."""

    def __init__(
        self,
        name: str,
        destination: Destination,
        trust: Trust,
        *,
        ask_password: AskPassword | None = None,
        sudo_password: str | None = None,
        connect_timeout_s: float = CONNECT_TIMEOUT_S,
        knock: Knock | None = None,
    ) -> None:
        self.name = name
        self.user = destination.user
        self.destination = destination
        self.transport_name = ""  # of the inventory: wired, router or ap
        self.clock_reading: ClockReading | None = None  # of the last batch
        self._trust = trust
        self._ask_password = ask_password
        self._passwords: dict[str, str] = {}  # by destination: a hop's is not the robot's
        self._sudo_password = sudo_password
        self._connect_timeout_s = connect_timeout_s
        self._knock = knock
        self._clients: list[paramiko.SSHClient] = []  # hops first
        self._proxies: list[paramiko.ProxyCommand] = []
        self._sftp = Sftp()
        self._ready: paramiko.Channel | None = None  # whose shell waits for the next batch

    # -- the connection

    def connect(self) -> paramiko.Transport:
        """The live connection. Raises Unreachable, HostKeyUnknown, HostKeyChanged or AuthenticationFailed."""
        transport = self._clients[-1].get_transport() if self._clients else None
        if transport is not None and transport.is_active():
            return transport
        self._let_go()
        through: Any = None
        for hop in self.destination.jumps:
            # A hop is a machine of its own, known by its own name.
            through = self._open(hop.asked or hop.host, hop, through)
        return self._open(self.name, self.destination, through)

    @property
    def secrets(self) -> tuple[str, ...]:
        """The passwords that were given for it: they are masked in whatever is written down of it."""
        return tuple({*self._passwords.values(), *filter(None, [self._sudo_password])})

    @property
    def peer(self) -> tuple[str, str]:
        """The robot's address and this machine's, as the first connection's ends have them. Raises TargetError without any."""
        self.connect()
        transport = self._clients[0].get_transport()
        sock: Any = None if transport is None else transport.sock
        if not hasattr(sock, "getsockname"):
            raise TargetError(f"{self.name} is reached through a command: there is no link of this machine's to look at")
        return str(sock.getpeername()[0]), str(sock.getsockname()[0])

    def _open(self, name: str, destination: Destination, through: paramiko.Transport | None) -> paramiko.Transport:
        """One more client at the end of the chain."""
        sock = self._socket(destination, through)
        client = paramiko.SSHClient()
        keys, _ = self._trust.known(name, destination)
        # The robot's name stands in for its address: paramiko then asks for a key type that is known, and compares.
        for key in keys:
            client.get_host_keys().add(name, key.get_name(), key)
        client.set_missing_host_key_policy(_Policy(self._trust, name, destination))
        try:
            self._log_in(client, name, destination, sock)
        except BaseException:
            client.close()
            sock.close()
            raise
        transport = client.get_transport()
        assert transport is not None
        transport.set_keepalive(_KEEPALIVE_S)
        self._clients.append(client)
        return transport

    def _socket(self, destination: Destination, through: paramiko.Transport | None) -> Any:
        who = str(destination)
        if through is not None:
            try:
                return through.open_channel(
                    "direct-tcpip", (destination.host, destination.port), ("127.0.0.1", 0), timeout=self._connect_timeout_s
                )
            except LOST as error:
                raise unreachable(who, "timeout", f"the host on the way says: {error}") from error
        if destination.proxy_command:
            self._proxies.append(paramiko.ProxyCommand(destination.proxy_command))
            return self._proxies[-1]
        knock, self._knock = self._knock, None
        return open_greeted(destination, self._connect_timeout_s) if knock is None else knock.take()

    def _log_in(self, client: paramiko.SSHClient, name: str, destination: Destination, sock: Any) -> None:
        who = str(destination)
        files: Any = [name for name in destination.identity_files if Path(name).is_file()]
        try:
            client.connect(
                name,
                username=destination.user,
                password=self._passwords.get(who),
                key_filename=files or None,
                timeout=_HANDSHAKE_S,
                banner_timeout=self._connect_timeout_s,
                auth_timeout=_HANDSHAKE_S,
                channel_timeout=_HANDSHAKE_S,
                allow_agent=not destination.identities_only,
                look_for_keys=not destination.identities_only,
                sock=sock,
            )
        except paramiko.BadHostKeyException as error:
            self._trust.check(name, destination, error.key)  # says what changed, and where
            raise
        except paramiko.AuthenticationException as error:
            self._not_let_in(client, destination, error)
        except LOST as error:
            if "No authentication methods" in str(error):  # paramiko's word for a user without any key
                self._not_let_in(client, destination, error)
                return
            raise unreachable(who, "lost", f"{str(error) or type(error).__name__} in the handshake") from error

    def _not_let_in(self, client: paramiko.SSHClient, destination: Destination, error: Exception) -> None:
        """Try a password, where somebody can give one; raises what is wrong."""
        who, transport = str(destination), client.get_transport()
        if "timeout" in str(error).lower():
            raise unreachable(who, "silent", "no answer while logging in") from error
        if transport is None or not transport.is_active():
            raise unreachable(who, "lost", "it hung up while logging in: going down, or tired of too many keys") from error
        if who not in self._passwords and self._ask_password is not None:
            self._with_password(transport, destination, self._ask_password(f"Password of {who}: "))
            return
        port = f"-p {destination.port} " if destination.port != 22 else ""
        raise AuthenticationFailed(
            f"{who} takes none of the keys of this user"
            + (", nor the password" if who in self._passwords else "")
            + (f" ({error})" if "encrypted" in str(error) else ""),
            f"ssh-copy-id {port}{destination.user}@{destination.host}",
        ) from error

    def _with_password(self, transport: paramiko.Transport, destination: Destination, password: str) -> None:
        try:
            transport.auth_password(destination.user, password)
        except paramiko.AuthenticationException as error:
            raise AuthenticationFailed(
                f"{destination} takes neither the keys of this user nor the password", f"ssh-copy-id {destination}"
            ) from error
        except LOST as error:
            raise unreachable(str(destination), "lost", f"{error} while logging in") from error
        self._passwords[str(destination)] = password
        if self._sudo_password is None and destination == self.destination:
            self._sudo_password = password  # on every Debian it is the same one

    def close(self) -> None:
        """See `Target.close`."""
        if self._knock is not None:
            self._knock.forget()
            self._knock = None
        self._let_go()

    def _let_go(self) -> None:
        """Of a connection, also of one that was lost."""
        self._ready = None
        self._sftp.forget()
        while self._clients:
            client = self._clients.pop()
            transport = client.get_transport()
            if transport is not None:
                # Its thread looks only ten times a second whether it is to end, unless the other side hangs up.
                with contextlib.suppress(OSError, EOFError, AttributeError):  # gone already; a proxy's has no such thing
                    transport.sock.shutdown(socket.SHUT_RDWR)
            client.close()
            if transport is not None:
                transport.join(1.0)  # a thread that still reads must not find its pipe closed
        while self._proxies:
            _end(self._proxies.pop())

    # -- what it can do

    def get_ready(self) -> None:
        """Let the login shell come up for a batch that is about to be asked: it takes as long as many a question does.

        A link that goes meanwhile is met by the batch as well, which tells. One shell at a time waits.
        """
        with contextlib.suppress(*LOST), Watch(self.connect(), _HANDSHAKE_S) as watch:
            if self._ready is None:
                channel = watch.transport.open_session(timeout=_HANDSHAKE_S)
                channel.settimeout(_HANDSHAKE_S)
                channel.exec_command(READ_BATCH)
                self._ready = channel

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        """See `Target.batch`. Where the link goes before anything was heard, raises Unreachable."""
        program = batch_program(scripts, bound_s, self._sudo_password)
        deadline = time.monotonic() + bound_s
        why = f"no end within {bound_s:g} s"
        ended = False  # the login shell
        self.clock_reading = None
        sent_ns = left_ns = 0
        with Watch(self.connect(), bound_s + 1.0) as watch:
            try:
                with self._channel(watch.transport, READ_BATCH, bound_s, self._take_ready(watch.transport)) as channel:
                    with contextlib.suppress(OSError):  # a shell that has ended already takes nothing; what it said is read
                        channel.sendall(program.payload[:-1])
                        sent_ns, left_ns = time.time_ns(), time.monotonic_ns()
                        channel.sendall(program.payload[-1:])  # nothing runs over there before this one has come
                        channel.shutdown_write()
                    while not program.reader.done and (left := deadline - time.monotonic()) > 0:
                        channel.settimeout(min(left, 0.5))
                        try:
                            data = channel.recv(1 << 16)
                        except TimeoutError:
                            continue
                        if not data:
                            ended = True
                            break
                        program.reader.feed(data)
                    said = _last_line(channel)
            except LOST as error:
                why = f"the link went: {str(error) or type(error).__name__}"
            if not program.reader.done and time.monotonic() < deadline and _is_gone(watch.transport):
                why = f"the link went: {watch.why}"
                if not program.reader.started:
                    raise unreachable(str(self.destination), "lost", watch.why)
            elif ended and not program.reader.started:
                raise self._shell_refused(said)
        if program.reader.clock is not None:
            said, heard_ns = program.reader.clock
            self.clock_reading = ClockReading(sent_ns, said, sent_ns + heard_ns - left_ns)
        return program.reader.outputs(why)

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
        status, lost = None, ""
        start = time.monotonic()
        with Watch(self.connect(), bound_s + 1.0) as watch:
            try:
                with self._channel(watch.transport, program.command, bound_s) as channel:
                    threading.Thread(target=send, args=(channel, program.payload), name="lupin-stdin", daemon=True).start()
                    for is_stderr, data in read(channel, start + bound_s):
                        streams.feed(data, is_stderr)
                    if channel.exit_status_ready() and channel.exit_status >= 0:
                        status = channel.exit_status
            except LOST as error:
                lost = str(error) or type(error).__name__
            if status is None and time.monotonic() < start + bound_s and _is_gone(watch.transport):
                lost = watch.why if watch.silent else lost or watch.why
        if status is not None and not streams.marked:
            if root and streams.entered and streams.last_error:
                raise RootRefused(
                    f"{self.name}: root is refused to {self.user}: {streams.last_error}",
                    f"lupin robots check {self.name} --ask-sudo-password",
                )
            raise self._shell_refused(streams.last_error)
        return streams.output(status, time.monotonic() - start, bound_s, lost)

    def put(self, path: str, data: bytes, *, mode: int = 0o644, root: bool = False, bound_s: float = 60.0) -> None:
        """See `Target.put`."""
        if not root:
            with Watch(self.connect(), bound_s + 1.0) as watch:
                if self._sftp.put(watch.transport, path, data, mode):
                    return
        # As root, or where SFTP isn't served or says no more than "Failure": a shell does it, or tells why not.
        output = self.run(put_program(path, len(data), mode), root=root, stdin=data, bound_s=bound_s)
        if not output.ok:
            self._require_link(output, f"{path} is as it was, or whole")
            raise TargetError(f"{self.name}: could not write {path}: {reason_of_failure(output)}; it is as it was")

    def get(self, path: str, *, root: bool = False, bound_s: float = 60.0) -> bytes | None:
        """See `Target.get`."""
        output = self.run(get_program(path), root=root, bound_s=bound_s)
        self._require_link(output, f"while {path} was read")
        return read_get(self.name, path, output)

    def forward(self, host: str, port: int, timeout_s: float = 5.0) -> paramiko.Channel:
        """A TCP connection that the robot makes to `host`:`port`. Raises Unreachable."""
        try:
            return self.connect().open_channel("direct-tcpip", (host, port), ("127.0.0.1", 0), timeout=timeout_s)
        except LOST as error:
            raise unreachable(str(self.destination), "lost", str(error)) from error

    def open_run(self, script: str, bound_s: float) -> paramiko.Channel:
        """A channel on which `script` has begun to run, for exchanges that go to and fro. Close it. Raises Unreachable."""
        program = run_program(script, root=False, stdin=b"", bound_s=bound_s, sudo_password=None)
        try:
            channel = self.connect().open_session(timeout=min(bound_s, _HANDSHAKE_S))
            channel.settimeout(bound_s)
            channel.exec_command(program.command)
            channel.sendall(program.payload)
            said = bytearray()
            while not said.endswith(program.mark + b"\n"):  # byte by byte: what follows is the caller's
                if not (byte := channel.recv(1)):
                    raise EOFError("the script did not begin")
                said += byte
        except LOST as error:
            raise unreachable(str(self.destination), "lost", str(error)) from error
        return channel

    def _require_link(self, output: Output, detail: str) -> None:
        """Raises Unreachable where a script has no end because the link went."""
        transport = self._clients[-1].get_transport() if self._clients else None
        if output.status is None and (transport is None or not transport.is_active()):
            raise unreachable(str(self.destination), "lost", detail)

    def _shell_refused(self, said: str) -> TargetError:
        """The login shell ended without having run what it was asked to: a start file that replaces it, or no shell at all."""
        return TargetError(
            f"{self.name}: the login shell of {self.user} does not run what it is asked to; it said: {said or 'nothing'}. "
            "A start file that ends with 'exec ...' must do so for terminals only: [ -t 0 ] && exec ...",
            f"ssh {self.destination.user}@{self.destination.host} echo fine",
        )

    # -- bounds

    @contextlib.contextmanager
    def _channel(
        self, transport: paramiko.Transport, command: str, bound_s: float, ready: paramiko.Channel | None = None
    ) -> Iterator[paramiko.Channel]:
        """A channel on which `command` runs: `ready`, where it does so already, or a new one."""
        channel = ready or transport.open_session(timeout=min(bound_s, _HANDSHAKE_S))
        try:
            channel.settimeout(bound_s)
            if ready is None:
                channel.exec_command(command)
            yield channel
        finally:
            channel.close()

    def _take_ready(self, transport: paramiko.Transport) -> paramiko.Channel | None:
        """The channel of `get_ready`, once, where it is of this connection and its shell still waits."""
        channel, self._ready = self._ready, None
        if channel is not None and (channel.get_transport() is not transport or channel.closed or channel.eof_received):
            channel.close()
            return None
        return channel


def _is_gone(transport: paramiko.Transport, grace_s: float = 0.2) -> bool:
    """Whether a connection whose channel ended has ended too: its thread closes the one a moment before the other."""
    transport.join(grace_s)
    return not transport.is_active()


def _last_line(channel: paramiko.Channel) -> str:
    """What was said last on standard error, as far as it is there."""
    lines = channel.recv_stderr(1 << 16).decode("utf-8", "replace").strip().splitlines() if channel.recv_stderr_ready() else []
    return lines[-1] if lines else ""


class _Policy(paramiko.MissingHostKeyPolicy):
    """A key that isn't known is a question for `Trust`; nothing is ever accepted without it."""

    def __init__(self, trust: Trust, name: str, destination: Destination) -> None:
        self._trust, self._name, self._destination = trust, name, destination

    def missing_host_key(self, client: paramiko.SSHClient, hostname: str, key: paramiko.PKey) -> None:
        self._trust.check(self._name, self._destination, key)


def _end(proxy: paramiko.ProxyCommand) -> None:
    """paramiko signals a proxy's process and leaves it and its pipes to the collector."""
    process = proxy.process
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        process.wait(1.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(1.0)
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            with contextlib.suppress(OSError):  # what was not sent yet has nowhere to go
                pipe.close()
