"""The keys that a login offers, in the order of OpenSSH's pubkey_prepare, and why others cannot be offered.

First the certificates of CertificateFile, then the agent's keys that an IdentityFile names, then the agent's others unless
IdentitiesOnly is set, then the other files. An IdentityFile may be a public file only: its private key is in the agent.
"""

from __future__ import annotations

import base64
import contextlib
import copy
import os
import shlex
import socket
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import paramiko
from paramiko.agent import AgentKey, AgentSSH
from paramiko.pkey import PublicBlob, UnknownKeyType

from lupin_cli.connection.destination import Destination
from lupin_runtime.bounded_file import is_file, read_bounded

_DEFAULT_NAMES = ("id_rsa", "id_ecdsa", "id_ecdsa_sk", "id_ed25519", "id_ed25519_sk", "id_xmss", "id_dsa")
_LISTING_TIMEOUT_S = 5.0
_SIGNING_TIMEOUT_S = 60.0  # a person may have to touch a security key, or to confirm
_MAX_KEY_BYTES = 1 << 20
_OPENSSH = b"-----BEGIN OPENSSH PRIVATE KEY-----"
_MAGIC = b"openssh-key-v1\0"


@dataclass(frozen=True)
class Problem:
    """Why a key cannot be offered, and the command that helps."""

    text: str
    next_command: str
    is_damage: bool = False  # the file is no key at all


@dataclass
class Identities:
    """The keys to offer, in order; close it when the login has ended."""

    keys: list[paramiko.PKey] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    agent: _Agent | None = None
    agent_name: str = ""

    def close(self) -> None:
        """Close the connection to the agent."""
        if self.agent is not None:
            self.agent.close()


class _Agent(AgentSSH):
    """The agent that listens on a socket. Raises OSError and paramiko.SSHException."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self.socket.settimeout(_LISTING_TIMEOUT_S)
            self.socket.connect(path)
            self._connect(self.socket)  # type: ignore[attr-defined]  # paramiko's own agent knows SSH_AUTH_SOCK only
            self.socket.settimeout(_SIGNING_TIMEOUT_S)
        except BaseException:
            self.socket.close()
            raise

    def close(self) -> None:
        self.socket.close()


def identities(destination: Destination) -> Identities:
    """Return the keys for a login at `destination`."""
    found = Identities()
    _open_agent(destination, found)
    agent_keys = list(found.agent.get_keys()) if found.agent is not None else []
    files = [Path(name) for name in destination.identity_files]
    if not files and not destination.identities_only:
        files = [Path.home() / ".ssh" / name for name in _DEFAULT_NAMES]
    by_blob = {_public_blob(file): file for file in reversed(files)}
    by_blob.pop(b"", None)
    plain: list[paramiko.PKey] = [key for key in agent_keys if _blob(key) in by_blob]
    others = [] if destination.identities_only else [key for key in agent_keys if _blob(key) not in by_blob]
    loaded: list[paramiko.PKey] = []
    private: paramiko.PKey | None
    for file in dict.fromkeys(files):
        if (blob := _public_blob(file)) and any(_blob(key) == blob for key in plain):
            private = next(key for key in plain if _blob(key) == blob)
        elif private := _load(file, found):
            loaded.append(private)
        else:
            continue
        certificate = Path(f"{str(file).removesuffix('.pub')}-cert.pub")
        if is_file(certificate):
            loaded += _certified([certificate], [private], found)
    certified = _certified((Path(name) for name in destination.certificate_files), [*agent_keys, *loaded], found)
    found.keys = [*certified, *plain, *others, *loaded]
    return found


def _open_agent(destination: Destination, found: Identities) -> None:
    """Connect to the agent that IdentityAgent names, or else SSH_AUTH_SOCK."""
    name = destination.identity_agent or "SSH_AUTH_SOCK"
    if name.lower() == "none":
        return
    is_variable = name == "SSH_AUTH_SOCK" or name.startswith("$")
    path = os.environ.get(name.lstrip("$").strip("{}"), "") if is_variable else name
    if not path:
        if name.startswith("$"):
            found.problems.append(Problem(f"IdentityAgent {name} is not set, so no agent was asked", "ssh-add -l"))
        return
    found.agent_name = path
    try:
        found.agent = _Agent(path)
    except (OSError, paramiko.SSHException, ValueError) as error:
        ask = f"SSH_AUTH_SOCK={shlex.quote(path)} ssh-add -l"
        found.problems.append(Problem(f"the agent at {path} does not answer: {error}", ask))


def _blob(key: paramiko.PKey) -> bytes:
    return key.blob if isinstance(key, AgentKey) else key.asbytes()


def _public_blob(file: Path) -> bytes:
    """Return the public key of an identity, from the file itself or from FILE.pub; empty if there is none."""
    for each in (file, Path(f"{file}.pub")):
        with contextlib.suppress(OSError, ValueError, IndexError):
            content = read_bounded(each, _MAX_KEY_BYTES)
            if content.lstrip().startswith(_OPENSSH):
                return _public_part(content)
            kind, encoded = content.split(None, 2)[:2]
            blob = base64.b64decode(encoded, validate=True)
            if blob.startswith(len(kind).to_bytes(4, "big") + kind):
                return blob
    return b""


def _public_part(content: bytes) -> bytes:
    """Return the public key in OpenSSH's private file, which a passphrase does not hide. Raises ValueError."""
    body = b"".join(line for line in content.split(b"\n") if not line.startswith(b"-----"))
    data = base64.b64decode(body)
    if not data.startswith(_MAGIC):
        raise ValueError("no OpenSSH private key")
    message = paramiko.Message(data[len(_MAGIC) :])
    for _ in range(3):  # cipher, key derivation and its options
        message.get_binary()
    if message.get_int() != 1:
        raise ValueError("not one key")
    return message.get_binary()


def _load(file: Path, found: Identities) -> paramiko.PKey | None:
    """Return the private key of a file; None, with the reason in `found`, if there is none to use."""
    agent = f"the agent at {found.agent_name}" if found.agent is not None else "no agent"
    has_it = f"{agent} has its key" if found.agent is None else f"{agent} does not have its key"
    private = Path(str(file).removesuffix(".pub"))
    quoted = shlex.quote(str(private))
    if not is_file(file):
        if is_file(f"{file}.pub"):
            found.problems.append(Problem(f"{file} is missing, and {has_it}", f"ssh-add {quoted}"))
        elif file.name not in _DEFAULT_NAMES:
            found.problems.append(Problem(f"{file}, an IdentityFile, does not exist", f"ls -l {quoted}"))
        return None
    try:
        key = paramiko.PKey.from_path(file)
    except (TypeError, paramiko.PasswordRequiredException):  # its library raises TypeError for a passphrase
        found.problems.append(Problem(f"{file} is encrypted with a passphrase, and {has_it}", f"ssh-add {quoted}"))
    except (paramiko.SSHException, OSError, ValueError, UnknownKeyType) as error:
        if _public_blob(file) and not read_bounded(file, _MAX_KEY_BYTES).lstrip().startswith(_OPENSSH):
            found.problems.append(Problem(f"{file} is a public key, and {has_it}", f"ssh-add {quoted}"))
        else:
            text = f"{file} is not a private key that can be read ({str(error) or type(error).__name__})"
            found.problems.append(Problem(text, f"ssh-keygen -y -f {quoted}", is_damage=True))
    else:
        key.public_blob = None  # paramiko would offer its certificate instead
        return key
    return None


def _certified(certificates: Iterable[Path], keys: list[paramiko.PKey], found: Identities) -> list[paramiko.PKey]:
    """Return for each certificate its private key, with it; a problem in `found` if there is none."""
    result = []
    for file in certificates:
        command = f"ssh-keygen -L -f {shlex.quote(str(file))}"
        try:
            certificate = PublicBlob.from_string(read_bounded(file, _MAX_KEY_BYTES).decode("utf-8", "replace"))
            private = next((key for key in keys if key.public_blob is None and _is_certified(certificate, key)), None)
        except (OSError, ValueError, IndexError, paramiko.SSHException) as error:
            text = f"{file} is no certificate that can be read ({str(error) or type(error).__name__})"
            found.problems.append(Problem(text, command, is_damage=True))
            continue
        if private is None:
            text = f"the private key of the certificate {file} is neither in a file nor in an agent"
            found.problems.append(Problem(text, command))
            continue
        key = AgentKey(private.agent, private.blob) if isinstance(private, AgentKey) else copy.copy(private)
        key.public_blob = certificate
        result.append(key)
    return result


def _is_certified(certificate: PublicBlob, key: paramiko.PKey) -> bool:
    """Return whether a certificate is that of a key: after its type and a nonce it has the key's own parameters."""
    name, blob = key.get_name(), _blob(key)
    message = paramiko.Message(certificate.key_blob)
    message.get_binary()
    message.get_binary()
    parameters = blob[4 + len(name) :]
    prefix = f"{name.removesuffix('@openssh.com')}-cert-v"
    return certificate.key_type.startswith(prefix) and message.get_remainder().startswith(parameters)
