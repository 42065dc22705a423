"""The TLS context of the console's server, whose certificate stays valid while the server runs."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from pathlib import Path

from lupin_runtime.console.certificate.store import NEXT_COMMAND, CertificateError, CertificateStore

REFRESH_S = 30.0  # until a new address or a step of the clock is noticed


class ServerCertificate:
    """Holds a context for aiohttp, `context`, and the certificates that it serves. Raises CertificateError.

    The server must not send Strict-Transport-Security: it would take from a browser the choice to go on while the robot's
    clock, or its own, is wrong.
    """

    def __init__(self, store: CertificateStore | None = None) -> None:
        self.store = store or CertificateStore()
        self.certificates = self.store.ensure()
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.minimum_version = ssl.TLSVersion.TLSv1_2
        self.context.set_alpn_protocols(["http/1.1"])
        _load(self.context, self.store.server_path)

    async def keep_current(self, log: Callable[[str], None], period_s: float = REFRESH_S) -> None:
        """Renew the certificate when the clock, the host's addresses or its files ask for it; runs until it is cancelled.

        New connections get the new certificate, open ones stay. What goes wrong is logged once, and the old one stays in use.
        """
        said: tuple[str, ...] = self.certificates.notes
        while True:
            await asyncio.sleep(period_s)
            try:
                current = await asyncio.to_thread(self.store.ensure)
                notes = current.notes
                if current.leaf.sha256 != self.certificates.leaf.sha256:
                    _load(self.context, self.store.server_path)
                    log(f"the server's certificate was renewed: {current.renewed or 'by another process'}")
                self.certificates = current
            except CertificateError as error:
                notes = (str(error),)
            for note in notes:
                if note not in said:
                    log(note)
            said = notes


def _load(context: ssl.SSLContext, path: Path) -> None:
    try:
        context.load_cert_chain(path)
    except OSError as error:  # also ssl.SSLError
        raise CertificateError(f"the certificate {path} cannot be used: {error}; next: {NEXT_COMMAND}") from error
