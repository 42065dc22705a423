"""Log in to an sshd: through jump hosts or a proxy command, after verifying its host key, with keys or a password."""

from __future__ import annotations

import contextlib
import logging
import shlex
import socket
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

import paramiko

from lupin_cli.connection.base import AuthenticationFailed, PrivateKeyMissing, PrivateKeyUnusable, Unreachable
from lupin_cli.connection.channel import CONNECTION_ERRORS
from lupin_cli.connection.connect import CONNECT_TIMEOUT_S, open_with_banner, unreachable
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.identities import Identities, identities
from lupin_cli.connection.proxy_command import ProxyCommand

logging.getLogger("paramiko").setLevel(logging.CRITICAL)  # its threads print the stacks of errors that Lupin reports itself

AskPassword: TypeAlias = Callable[[str], str]
Stream: TypeAlias = socket.socket | paramiko.Channel | ProxyCommand  # what an SSH connection can run over

KEEPALIVE_S = 5  # also between calls, so that a dead link is known before the next one
HANDSHAKE_TIMEOUT_S = 10.0  # the key exchange takes seconds on a robot that is booting


# What OpenSSH offers by default, in its order, as far as paramiko knows it; paramiko itself still offers 3des-cbc and hmac-md5.
CIPHERS = ("aes128-ctr", "aes192-ctr", "aes256-ctr", "aes128-gcm@openssh.com", "aes256-gcm@openssh.com")
MACS = (
    *("hmac-sha2-256-etm@openssh.com", "hmac-sha2-512-etm@openssh.com"),
    *("hmac-sha2-256", "hmac-sha2-512", "hmac-sha1"),
)
_SIGNATURES = {"ssh-rsa": ("rsa-sha2-512", "rsa-sha2-256")}  # how a key of this type signs


def _make_transport(stream: Stream, known_types: Sequence[str]) -> paramiko.Transport:
    """Return a transport that asks the server for a host key of a known type first."""
    transport = paramiko.Transport(stream)
    offered = transport.get_security_options()
    offered.ciphers, offered.digests = CIPHERS, MACS
    wanted = [each for key_type in known_types for each in _SIGNATURES.get(key_type, (key_type,))]
    first = [each for each in wanted if each in offered.key_types]
    offered.key_types = [*first, *(each for each in offered.key_types if each not in first)]
    return transport


class _AnsweredLateError(Exception):
    """The sshd closed the connection while a person was asked for a host key or a password; the answer is known now."""


class Connection:
    """The SSH connection to a robot: a chain of paramiko transports, those of jump hosts first.

    `ask_password` is None if nobody can be asked.
    """

    def __init__(
        self,
        name: str,
        destination: Destination,
        known_hosts: KnownHosts,
        ask_password: AskPassword | None = None,
        connect_timeout_s: float = CONNECT_TIMEOUT_S,
    ) -> None:
        self.name = name
        self.destination = destination
        self._known_hosts = known_hosts
        self._ask_password = ask_password
        self._passwords: dict[str, str] = {}  # by destination: jump hosts have other passwords
        self._connect_timeout_s = connect_timeout_s
        self._transports: list[paramiko.Transport] = []
        self._proxies: list[ProxyCommand] = []

    def open(self) -> tuple[paramiko.Transport, bool]:
        """Return the live connection, and whether it is a new one.

        Raises Unreachable, HostKeyUnknown, HostKeyChanged or AuthenticationFailed.
        """
        if transport := self.live:
            return transport, False
        self.close()
        transport = None
        for hop in self.destination.jumps:
            try:
                transport = self._log_in(hop.original_host or hop.host, hop, transport)  # a jump host has its own host key
            except Unreachable as error:
                message = f"{self.destination}: the jump host on the way to it cannot be reached: {error}"
                raise Unreachable(message, "jump", error.next_command) from error
        return self._log_in(self.name, self.destination, transport), True

    @property
    def live(self) -> paramiko.Transport | None:
        """The open connection to the robot, if there is one."""
        transport = self._transports[-1] if self._transports else None
        return transport if transport is not None and transport.is_active() else None

    @property
    def passwords(self) -> tuple[str, ...]:
        """All passwords that were typed, to be masked in everything that is stored."""
        return tuple(self._passwords.values())

    @property
    def password(self) -> str | None:
        """The password that was typed for the robot itself."""
        return self._passwords.get(str(self.destination))

    @property
    def first_socket(self) -> socket.socket | None:
        """This machine's own socket, which leads to the robot or the first jump host; None behind a proxy command."""
        found = self._transports[0].sock if self._transports else None
        return found if isinstance(found, socket.socket) else None

    def close(self) -> None:
        """Close the whole chain. Connections that were lost are closed too."""
        while self._transports:
            transport = self._transports.pop()
            # paramiko's thread checks only ten times a second whether it should stop, unless its socket is shut down.
            with contextlib.suppress(OSError, EOFError, AttributeError):  # closed already; proxies have no shutdown()
                transport.sock.shutdown(socket.SHUT_RDWR)
            transport.close()
            transport.join(1.0)  # a proxy's pipe must not be closed while the thread reads it
        while self._proxies:
            self._proxies.pop().terminate()

    def _log_in(self, name: str, destination: Destination, jump_transport: paramiko.Transport | None) -> paramiko.Transport:
        """Append a transport for `destination` to the chain, connected through the previous one.

        An sshd waits two minutes for a login. A question may stay open for longer, so after its answer a second login follows.
        """
        for _ in range(2):  # a host key and a password may both be asked for
            try:
                return self._try_log_in(name, destination, jump_transport)
            except _AnsweredLateError:
                continue
        return self._try_log_in(name, destination, jump_transport)

    def _try_log_in(self, name: str, destination: Destination, jump_transport: paramiko.Transport | None) -> paramiko.Transport:
        stream = self._open_stream(name, destination, jump_transport)
        transport, was_asked = None, False
        try:
            try:
                transport = _make_transport(stream, self._known_hosts.key_types(name, destination))
                transport.banner_timeout = self._connect_timeout_s
                transport.auth_timeout = transport.channel_timeout = HANDSHAKE_TIMEOUT_S
                transport.start_client(timeout=HANDSHAKE_TIMEOUT_S)
                was_asked = self._known_hosts.verify(name, destination, transport.get_remote_server_key())
                self._authenticate(transport, destination)
            except CONNECTION_ERRORS as error:
                if isinstance(stream, ProxyCommand):
                    raise stream.failure(name, destination, str(error) or type(error).__name__) from error
                detail = f"{str(error) or type(error).__name__} in the SSH handshake"
                raise unreachable(str(destination), "lost", detail) from error
        except BaseException as error:
            if transport is not None:
                transport.close()
            stream.close()
            if was_asked and isinstance(error, Unreachable):
                raise _AnsweredLateError from error
            raise
        transport.set_keepalive(KEEPALIVE_S)
        self._transports.append(transport)
        return transport

    def _open_stream(self, name: str, destination: Destination, jump_transport: paramiko.Transport | None) -> Stream:
        if jump_transport is not None:
            try:
                return jump_transport.open_channel(
                    "direct-tcpip", (destination.host, destination.port), ("127.0.0.1", 0), timeout=self._connect_timeout_s
                )
            except CONNECTION_ERRORS as error:
                raise unreachable(str(destination), "timeout", f"the jump host reports: {error}") from error
        if destination.proxy_command:
            self._proxies.append(ProxyCommand(name, destination))
            return self._proxies[-1]
        return open_with_banner(destination, self._connect_timeout_s)

    def _authenticate(self, transport: paramiko.Transport, destination: Destination) -> None:
        """Log in with a key, or else with a password. Raises AuthenticationFailed, with every key that could not be offered."""
        with contextlib.closing(identities(destination)) as found:
            for key in found.keys:
                with _named_failures(transport, destination):
                    transport.auth_publickey(destination.user, key)
                if transport.is_authenticated():
                    return
        address = str(destination)
        password = self._passwords.get(address)
        if password is None and self._ask_password is not None:
            password = self._ask_password(f"Password of {address}: ")
            self._passwords[address] = password
            self._log_in_with_password(transport, destination, password)
            return
        if password is not None:
            with _named_failures(transport, destination):
                transport.auth_password(destination.user, password)
            if transport.is_authenticated():
                return
        raise _refusal(destination, found, with_password=password is not None)

    def _log_in_with_password(self, transport: paramiko.Transport, destination: Destination, password: str) -> None:
        try:
            transport.auth_password(destination.user, password)
        except CONNECTION_ERRORS as error:
            if not transport.is_active():  # paramiko reports this as a refused password, too
                raise _AnsweredLateError from error
            del self._passwords[str(destination)]
            raise AuthenticationFailed(
                f"{destination} accepts neither this user's keys nor the password", _copy_key_command(destination)
            ) from error


@contextlib.contextmanager
def _named_failures(transport: paramiko.Transport, destination: Destination) -> Iterator[None]:
    """Go on after a refused key or password. Raises Unreachable if the connection ended, or no answer came."""
    try:
        yield
    except paramiko.AuthenticationException as error:
        if "timeout" in str(error).lower():
            raise unreachable(str(destination), "silent", "no answer to the login") from error
        if not transport.is_active():
            detail = "it closed the connection during the login: it is shutting down, or was offered too many keys"
            raise unreachable(str(destination), "lost", detail) from error


def _refusal(destination: Destination, found: Identities, *, with_password: bool) -> AuthenticationFailed:
    """Return the error for a login that failed: it names the agent, the file or the passphrase that would have helped."""
    reasons = "; ".join(problem.text for problem in found.problems)
    damaged = next((problem for problem in found.problems if problem.is_damage), None)
    if damaged and not with_password:
        return PrivateKeyUnusable(f"{destination}: {reasons}, and no other key is accepted", damaged.next_command)
    if not found.keys and not with_password:
        if not reasons:
            return PrivateKeyMissing(f"{destination}: this user has no private key", _copy_key_command(destination))
        return PrivateKeyMissing(
            f"{destination}: this user has no private key that can be offered: {reasons}", found.problems[0].next_command
        )
    accepted = "accepts none of this user's keys" + (", nor the password" if with_password else "")
    next_command = found.problems[0].next_command if reasons else _copy_key_command(destination)
    return AuthenticationFailed(f"{destination} {accepted}" + (f" ({reasons})" if reasons else ""), next_command)


def _copy_key_command(destination: Destination) -> str:
    """Return what installs the user's key on the machine, and creates the key if the user has none."""
    own_key = next((f"-i {shlex.quote(name)} " for name in destination.identity_files if Path(f"{name}.pub").is_file()), "")
    create = "" if own_key or any(Path("~/.ssh").expanduser().glob("id_*")) else "ssh-keygen -t ed25519 && "
    return f"{create}ssh-copy-id {own_key}{destination.login_command.removeprefix('ssh ')}"
