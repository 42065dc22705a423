"""The operator's release key: an Ed25519 key that signs the releases which this operator deploys.

It is in `${XDG_STATE_HOME:-~/.local/state}/lupin/release-key`, in the format of OpenSSH, and readable by its owner only.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import shlex
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.connection.this_operator import this_operator
from lupin_cli.release.verify_release import NAMESPACE, SIGNER
from lupin_runtime.bounded_file import read_bounded
from lupin_runtime.stack.runs import make_state_folder, state_directory

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

KEY_TYPE = "ssh-ed25519"
_PUBLIC_KEY = re.compile(rf"(?:^|\s)({KEY_TYPE}) (AAAA[A-Za-z0-9+/]+=*)(?: ([^\n]*))?")
_ARMOR_COLUMNS = 70


class SigningKeyError(Exception):
    """The release key cannot be read or created; the message says why. `next_command` is what the operator should type next."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


@dataclass(frozen=True)
class PublicKey:
    """The public half of a release key."""

    encoded: str  # base64 of the SSH wire format
    comment: str = ""  # whose it is: user@machine

    @classmethod
    def parse(cls, line: str) -> PublicKey:
        """Read a line of an OpenSSH public key or of a list of allowed signers. Raises ValueError."""
        found = _PUBLIC_KEY.search(line)
        if found is None or line.lstrip().startswith("#"):
            raise ValueError(f"expected a public key: {KEY_TYPE} AAAA… user@machine, found {line.strip()[:80]!r}")
        return cls(found[2], (found[3] or "").strip())

    @property
    def fingerprint(self) -> str:
        """The fingerprint as `ssh-keygen -l` prints it."""
        digest = hashlib.sha256(base64.b64decode(self.encoded + "==")).digest()
        return f"SHA256:{base64.b64encode(digest).decode().rstrip('=')}"

    @property
    def signers_line(self) -> str:
        """The line by which a robot trusts this key for releases, and for nothing else."""
        return f'{SIGNER} namespaces="{NAMESPACE}" {KEY_TYPE} {self.encoded} {self.comment}'.rstrip() + "\n"

    def __str__(self) -> str:
        return f"{self.comment} ({self.fingerprint})" if self.comment else self.fingerprint


@dataclass(frozen=True)
class SigningKey:
    """A release key."""

    private: Ed25519PrivateKey

    @property
    def public(self) -> PublicKey:
        """Its public half, with this operator's name."""
        from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

        line = self.private.public_key().public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH).decode()
        return PublicKey(line.split()[1], this_operator())

    def sign(self, text: bytes) -> bytes:
        """Return the signature of `text` as a file that `ssh-keygen -Y verify` reads (PROTOCOL.sshsig of OpenSSH)."""
        header = _strings(NAMESPACE.encode(), b"", b"sha512")  # b"" is reserved
        signed = b"SSHSIG" + header + _strings(hashlib.sha512(text).digest())
        signature = _strings(KEY_TYPE.encode(), self.private.sign(signed))
        public = base64.b64decode(self.public.encoded)
        blob = b"SSHSIG" + struct.pack(">I", 1) + _strings(public) + header + _strings(signature)
        encoded = base64.b64encode(blob).decode()
        lines = [encoded[at : at + _ARMOR_COLUMNS] for at in range(0, len(encoded), _ARMOR_COLUMNS)]
        return "\n".join(["-----BEGIN SSH SIGNATURE-----", *lines, "-----END SSH SIGNATURE-----", ""]).encode()


def _strings(*values: bytes) -> bytes:
    """Encode strings as in RFC 4251, section 5: each after its length."""
    return b"".join(struct.pack(">I", len(value)) + value for value in values)


def key_path() -> Path:
    """Return the path of this operator's release key."""
    return state_directory() / "release-key"


def load_key() -> SigningKey | None:
    """Return this operator's release key; None if there is none yet. Raises SigningKeyError."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_ssh_private_key

    path = key_path()
    move_away = shlex.join(["mv", str(path), f"{path}.old"])
    try:
        found = path.stat()
        private = load_ssh_private_key(read_bounded(path), password=None)
    except FileNotFoundError:
        return None
    except OSError as error:
        problem = error.strerror or error
        raise SigningKeyError(
            f"the release key {path} cannot be read: {problem}; without it, a new one is made", move_away
        ) from error
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise SigningKeyError(
            f"the release key {path} is damaged: {error}; without it, a new one is made", move_away
        ) from error
    if not isinstance(private, Ed25519PrivateKey):
        raise SigningKeyError(f"the key {path} is not an Ed25519 key; without it, a new one is made", move_away)
    if found.st_uid != os.geteuid() or found.st_mode & 0o077:
        raise SigningKeyError(
            f"other users may read the release key {path}; if none has, protect it; otherwise remove it, for a new one",
            shlex.join(["chmod", "600", str(path)]),
        )
    return SigningKey(private)


def ensure_key() -> SigningKey:
    """Return this operator's release key; create it if there is none yet. Raises SigningKeyError."""
    return load_key() or _create_key()


def _create_key() -> SigningKey:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    path = key_path()
    content = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption())
    temporary = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
    try:
        make_state_folder(path.parent)
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        try:
            os.link(temporary, path)  # unlike a rename, it never replaces the key of a deploy that runs at the same time
        except FileExistsError:
            pass
        finally:
            temporary.unlink()
    except OSError as error:
        raise SigningKeyError(
            f"the release key {path} cannot be created: {error.strerror or error}", "export XDG_STATE_HOME=..."
        ) from error
    key = load_key()
    assert key is not None
    return key
