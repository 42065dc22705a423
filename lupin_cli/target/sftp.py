"""Files over SFTP, where the robot serves it: whole or not at all, in a fraction of the time that a shell takes."""

from __future__ import annotations

import contextlib
import secrets

import paramiko

from lupin_cli.target.channel import LOST


class Sftp:
    """The SFTP of one connection, opened when it is first needed. Whoever uses it bounds it."""

    def __init__(self) -> None:
        self._client: paramiko.SFTPClient | None = None

    def forget(self) -> None:
        """The connection is gone."""
        self._client = None

    def put(self, transport: paramiko.Transport, path: str, data: bytes, mode: int) -> bool:
        """Write `path`; False where that did not work and nothing has changed."""
        name = path.removeprefix("~/")  # SFTP starts at home
        new = f"{name}.lupin-{secrets.token_hex(4)}"
        try:
            client = self._opened(transport)
            with client.open(new, "wbx") as file:
                file.chmod(0o600)
                file.set_pipelined(True)
                file.write(data)
                file.flush()
                file.set_pipelined(False)
                file.chmod(mode)
                # paramiko has no name for OpenSSH's extension; without it a power cut may leave the name with no bytes.
                client._request(paramiko.sftp.CMD_EXTENDED, "fsync@openssh.com", file.handle)  # type: ignore[attr-defined]
                if file.stat().st_size != len(data):
                    raise OSError("short write")
            client.posix_rename(new, name)
        except (*LOST, paramiko.SFTPError):  # SFTPError: a login shell that talks spoils the protocol
            if transport.is_active() and self._client is not None:
                with contextlib.suppress(*LOST, paramiko.SFTPError):  # it may never have come into being
                    self._client.remove(new)
            return False
        return True

    def _opened(self, transport: paramiko.Transport) -> paramiko.SFTPClient:
        if self._client is None:
            self._client = paramiko.SFTPClient.from_transport(transport)
            assert self._client is not None
        return self._client
