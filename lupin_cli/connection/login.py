"""Log in to an sshd: through jump hosts or a proxy command, after verifying its host key, with keys or a password."""

from __future__ import annotations

import contextlib
import logging
import shlex
import socket
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import paramiko
from paramiko.pkey import UnknownKeyType

from lupin_cli.connection.base import AuthenticationFailed, PrivateKeyMissing, PrivateKeyUnusable, Unreachable
from lupin_cli.connection.channel import CONNECTION_ERRORS
from lupin_cli.connection.connect import CONNECT_TIMEOUT_S, open_with_banner, unreachable
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts

logging.getLogger("paramiko").setLevel(logging.CRITICAL)  # its threads print the stacks of errors that Lupin reports itself

AskPassword: TypeAlias = Callable[[str], str]
Stream: TypeAlias = socket.socket | paramiko.Channel | paramiko.ProxyCommand  # what an SSH connection can run over

_DEFAULT_KEYS = ("id_rsa", "id_ecdsa", "id_ed25519")  # that paramiko looks for
KEEPALIVE_S = 5  # also between calls, so that a dead link is known before the next one
HANDSHAKE_TIMEOUT_S = 10.0  # the key exchange takes seconds on a robot that is booting


# What OpenSSH offers by default, in its order, as far as paramiko knows it; paramiko itself still offers 3des-cbc and hmac-md5.
CIPHERS = ("aes128-ctr", "aes192-ctr", "aes256-ctr", "aes128-gcm@openssh.com", "aes256-gcm@openssh.com")
MACS = (
    *("hmac-sha2-256-etm@openssh.com", "hmac-sha2-512-etm@openssh.com"),
    *("hmac-sha2-256", "hmac-sha2-512", "hmac-sha1"),
)
_SIGNATURES = {"ssh-rsa": ("rsa-sha2-512", "rsa-sha2-256")}  # how a key of this type signs


class _TransportFactory:
    """Makes the transport of a client: it asks the server for a host key of a known type first."""

    def __init__(self, key_types: Sequence[str]) -> None:
        self._key_types = [each for key_type in key_types for each in _SIGNATURES.get(key_type, (key_type,))]

    def __call__(self, stream: Any, **options: Any) -> paramiko.Transport:
        transport = paramiko.Transport(stream, **options)
        offered = transport.get_security_options()
        offered.ciphers, offered.digests = CIPHERS, MACS
        first = [each for each in self._key_types if each in offered.key_types]
        offered.key_types = [*first, *(each for each in offered.key_types if each not in first)]
        return transport


class _AnsweredLateError(Exception):
    """The sshd closed the connection while a person was asked for a host key or a password; the answer is known now."""


class Connection:
    """The SSH connection to a robot: a chain of paramiko clients, those of jump hosts first.

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
        self._clients: list[paramiko.SSHClient] = []
        self._proxies: list[paramiko.ProxyCommand] = []

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
        transport = self._clients[-1].get_transport() if self._clients else None
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
        transport = self._clients[0].get_transport() if self._clients else None
        found = None if transport is None else transport.sock
        return found if isinstance(found, socket.socket) else None

    def close(self) -> None:
        """Close the whole chain. Connections that were lost are closed too."""
        while self._clients:
            client = self._clients.pop()
            transport = client.get_transport()
            if transport is not None:
                # paramiko's thread checks only ten times a second whether it should stop, unless its socket is shut down.
                with contextlib.suppress(OSError, EOFError, AttributeError):  # closed already; proxies have no shutdown()
                    transport.sock.shutdown(socket.SHUT_RDWR)
            client.close()
            if transport is not None:
                transport.join(1.0)  # a proxy's pipe must not be closed while the thread reads it
        while self._proxies:
            _terminate_proxy(self._proxies.pop())

    def _log_in(self, name: str, destination: Destination, jump_transport: paramiko.Transport | None) -> paramiko.Transport:
        """Append a client for `destination` to the chain, connected through the previous one.

        An sshd waits two minutes for a login. A question may stay open for longer, so after its answer a second login follows.
        """
        for _ in range(2):  # a host key and a password may both be asked for
            try:
                return self._try_log_in(name, destination, jump_transport)
            except _AnsweredLateError:
                continue
        return self._try_log_in(name, destination, jump_transport)

    def _try_log_in(self, name: str, destination: Destination, jump_transport: paramiko.Transport | None) -> paramiko.Transport:
        stream = self._open_stream(destination, jump_transport)
        client = paramiko.SSHClient()
        question = _AskKnownHosts(self._known_hosts, name, destination)
        client.set_missing_host_key_policy(question)
        try:
            self._authenticate(client, name, destination, stream)
        except Unreachable as error:
            client.close()
            stream.close()
            if question.answered:
                raise _AnsweredLateError from error
            raise
        except BaseException:
            client.close()
            stream.close()
            raise
        transport = client.get_transport()
        assert transport is not None
        transport.set_keepalive(KEEPALIVE_S)
        self._clients.append(client)
        return transport

    def _open_stream(self, destination: Destination, jump_transport: paramiko.Transport | None) -> Stream:
        if jump_transport is not None:
            try:
                return jump_transport.open_channel(
                    "direct-tcpip", (destination.host, destination.port), ("127.0.0.1", 0), timeout=self._connect_timeout_s
                )
            except CONNECTION_ERRORS as error:
                raise unreachable(str(destination), "timeout", f"the jump host reports: {error}") from error
        if destination.proxy_command:
            self._proxies.append(paramiko.ProxyCommand(destination.proxy_command))
            return self._proxies[-1]
        return open_with_banner(destination, self._connect_timeout_s)

    def _authenticate(self, client: paramiko.SSHClient, name: str, destination: Destination, stream: Stream) -> None:
        # paramiko accepts a list too; its type stubs know one file only.
        files: Any = [name for name in destination.identity_files if Path(name).is_file()]
        try:
            client.connect(
                name,
                username=destination.user,
                password=self._passwords.get(str(destination)),
                key_filename=files or None,
                timeout=HANDSHAKE_TIMEOUT_S,
                banner_timeout=self._connect_timeout_s,
                auth_timeout=HANDSHAKE_TIMEOUT_S,
                channel_timeout=HANDSHAKE_TIMEOUT_S,
                allow_agent=not destination.identities_only,
                look_for_keys=not destination.identities_only,
                sock=stream,
                transport_factory=_TransportFactory(self._known_hosts.key_types(name, destination)),
            )
        except paramiko.AuthenticationException as error:
            self._handle_auth_failure(client, destination, error)
        except CONNECTION_ERRORS as error:
            if "No authentication methods" in str(error):  # paramiko's message if the user has no key at all
                self._handle_auth_failure(client, destination, error)
                return
            transport = client.get_transport()
            if transport is not None and transport.is_active() and (file := _unreadable_key(destination)):
                raise PrivateKeyUnusable(
                    f"{destination}: {file} is not a private key that can be read ({error}), and no other one is accepted",
                    f"ssh-keygen -y -f {shlex.quote(file)}",
                ) from error
            if destination.proxy_command:
                message = f"{destination}: the proxy command on the way to it does not work: {destination.proxy_command}"
                raise Unreachable(f"{message} ({str(error) or type(error).__name__})", "jump") from error
            detail = f"{str(error) or type(error).__name__} in the SSH handshake"
            raise unreachable(str(destination), "lost", detail) from error

    def _handle_auth_failure(self, client: paramiko.SSHClient, destination: Destination, error: Exception) -> None:
        """Log in with a password if somebody can be asked for it; otherwise raise the reason of the failure."""
        address, transport = str(destination), client.get_transport()
        if "timeout" in str(error).lower():
            raise unreachable(address, "silent", "no answer to the login") from error
        if transport is None or not transport.is_active():
            detail = "it closed the connection during the login: it is shutting down, or was offered too many keys"
            raise unreachable(address, "lost", detail) from error
        if address not in self._passwords and self._ask_password is not None:
            self._log_in_with_password(transport, destination, self._ask_password(f"Password of {address}: "))
            return
        if address not in self._passwords and not _has_private_key(destination):
            raise PrivateKeyMissing(f"{address}: this user has no private key", _copy_key_command(destination)) from error
        raise AuthenticationFailed(
            f"{address} accepts none of this user's keys"
            + (", nor the password" if address in self._passwords else "")
            + (f" ({error})" if "encrypted" in str(error) else ""),
            _copy_key_command(destination),
        ) from error

    def _log_in_with_password(self, transport: paramiko.Transport, destination: Destination, password: str) -> None:
        self._passwords[str(destination)] = password
        try:
            transport.auth_password(destination.user, password)
        except CONNECTION_ERRORS as error:
            if not transport.is_active():  # paramiko reports this as a refused password, too
                raise _AnsweredLateError from error
            del self._passwords[str(destination)]
            raise AuthenticationFailed(
                f"{destination} accepts neither this user's keys nor the password", _copy_key_command(destination)
            ) from error


def _unreadable_key(destination: Destination) -> str:
    """Return the first private key file for `destination` that cannot be parsed; empty if there is none."""
    for file in _private_key_files(destination):
        try:
            paramiko.PKey.from_path(file)
        except paramiko.PasswordRequiredException:
            continue
        except (paramiko.SSHException, OSError, ValueError, UnknownKeyType):
            return str(file)
    return ""


def _private_key_files(destination: Destination) -> list[Path]:
    files = [Path(name) for name in destination.identity_files]
    if not destination.identities_only:
        files += [Path.home() / ".ssh" / name for name in _DEFAULT_KEYS]
    return [file for file in files if file.is_file()]


def _has_private_key(destination: Destination) -> bool:
    """Return whether the user can offer a key for `destination`: from a file, or from an agent."""
    if _private_key_files(destination):
        return True
    if destination.identities_only:
        return False
    with contextlib.closing(paramiko.Agent()) as agent:
        return bool(agent.get_keys())


class _AskKnownHosts(paramiko.MissingHostKeyPolicy):
    """Leaves a host key that paramiko does not know to `KnownHosts`; no key is accepted without it."""

    def __init__(self, known_hosts: KnownHosts, name: str, destination: Destination) -> None:
        self._known_hosts, self._name, self._destination = known_hosts, name, destination
        self.answered = False  # whether the key was accepted just now, possibly by a person who took long

    def missing_host_key(self, _client: paramiko.SSHClient, _hostname: str, key: paramiko.PKey) -> None:
        """See `paramiko.MissingHostKeyPolicy`."""
        self.answered = self._known_hosts.verify(self._name, self._destination, key)


def _copy_key_command(destination: Destination) -> str:
    """Return what installs the user's key on the machine, and creates the key if the user has none."""
    own_key = next((f"-i {shlex.quote(name)} " for name in destination.identity_files if Path(f"{name}.pub").is_file()), "")
    create = "" if own_key or any(Path("~/.ssh").expanduser().glob("id_*")) else "ssh-keygen -t ed25519 && "
    return f"{create}ssh-copy-id {own_key}{destination.login_command.removeprefix('ssh ')}"


def _terminate_proxy(proxy: paramiko.ProxyCommand) -> None:
    """Terminate a proxy command and close its pipes; paramiko only signals it."""
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
            with contextlib.suppress(OSError):  # unsent bytes cannot be written any more
                pipe.close()
