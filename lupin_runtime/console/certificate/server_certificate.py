"""The console's TLS context. Its certificate is kept valid while the server runs."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from pathlib import Path

from lupin_runtime.console.certificate.store import NEXT_COMMAND, CertificateError, CertificateStore

REFRESH_PERIOD_S = 30.0  # a new address or a step of the clock is noticed within this time


class ServerCertificate:
    """The TLS context, `context`, and the certificates that it serves. The constructor raises CertificateError.

    The server must not send Strict-Transport-Security: browsers would then no longer let people pass the warning that appears
    while one of the clocks is wrong.
    """

    def __init__(self, store: CertificateStore | None = None) -> None:
        self.store = store or CertificateStore()
        self.certificates = self.store.ensure()
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.minimum_version = ssl.TLSVersion.TLSv1_2
        self.context.set_alpn_protocols(["http/1.1"])
        _load(self.context, self.store.server_path)

    async def keep_current(self, log: Callable[[str], None], period_s: float = REFRESH_PERIOD_S) -> None:
        """Renew the certificate when the clock, the host's addresses or the files require it. Runs until it is canceled.

        New connections get the new certificate, open ones stay open. An error is logged once, and the old certificate stays in
        use.
        """
        logged: tuple[str, ...] = self.certificates.notes
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
                if note not in logged:
                    log(note)
            logged = notes


def _load(context: ssl.SSLContext, path: Path) -> None:
    try:
        context.load_cert_chain(path)
    except OSError as error:  # also ssl.SSLError
        raise CertificateError(f"the certificate {path} cannot be used: {error}; next: {NEXT_COMMAND}") from error
