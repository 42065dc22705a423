"""The server's own certificate, the leaf: what it names, how long it is valid, and when it must be replaced.

The host's clock may be wrong: a robot's computer has no battery-backed clock and boots with the time of its last shutdown, or
that of its image. Devices judge the certificate by their own clocks. So it begins a month before it is issued, and is replaced
as soon as the clock is outside its validity; a clock that is certainly wrong is not used.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from dataclasses import dataclass

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from lupin_runtime.console.certificate.certificate_authority import CertificateAuthority, fingerprint, private_pem
from lupin_runtime.console.host_addresses import LOOPBACK, Address, HostAddresses

# Browsers refuse more than 398 days of public authorities, and Apple's more than 825 of any (support.apple.com/103214).
BEFORE_ISSUE = datetime.timedelta(days=31)
AFTER_ISSUE = datetime.timedelta(days=366)
RENEW_BEFORE_END = datetime.timedelta(days=31)

# A clock outside these times is certainly wrong: this file is younger, and the authority ends in 2049.
EARLIEST = datetime.datetime(2026, 11, 1, tzinfo=datetime.timezone.utc)
LATEST = datetime.datetime(2048, 1, 1, tzinfo=datetime.timezone.utc)

MAX_NAMES = 64  # names and addresses in one certificate, those of earlier networks included


@dataclass(frozen=True)
class Leaf:
    """The server's key and certificate, and the one that issued it, which the server sends too."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate
    issuing: x509.Certificate

    @property
    def sha256(self) -> str:
        """Fingerprint of the certificate."""
        return fingerprint(self.certificate)

    @property
    def issued(self) -> datetime.datetime:
        """When it was issued."""
        return self.certificate.not_valid_before_utc + BEFORE_ISSUE

    @property
    def names(self) -> tuple[str, ...]:
        """The DNS names that it is valid for."""
        return tuple(self._alternative_names().get_values_for_type(x509.DNSName))

    @property
    def addresses(self) -> tuple[Address, ...]:
        """The addresses that it is valid for."""
        found = self._alternative_names().get_values_for_type(x509.IPAddress)
        return tuple(address for address in found if isinstance(address, Address))

    def _alternative_names(self) -> x509.SubjectAlternativeName:
        return self.certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value

    def pem(self) -> bytes:
        """Key and chain, as TLS servers read them: secret."""
        chain = (self.certificate, self.issuing)
        return private_pem(self.key) + b"".join(one.public_bytes(serialization.Encoding.PEM) for one in chain)


def is_plausible(clock: datetime.datetime) -> bool:
    """Whether a clock may be right."""
    return EARLIEST <= clock <= LATEST


def reference_time(clock: datetime.datetime, issued: datetime.datetime | None) -> datetime.datetime:
    """The time to issue and to judge at: the clock's, or where that is certainly wrong, when the last leaf was issued."""
    return clock if is_plausible(clock) else issued or EARLIEST


def subjects(authority: CertificateAuthority, reachable: HostAddresses) -> tuple[tuple[str, ...], tuple[Address, ...]]:
    """The names and addresses that a leaf must have: the host's and localhost, as far as the authority permits them."""
    names = dict.fromkeys(("localhost", *reachable.names))
    addresses = dict.fromkeys((*LOOPBACK, *reachable.addresses))
    permitted = tuple(filter(authority.permits, names))
    return permitted, tuple(filter(authority.permits, addresses))[: MAX_NAMES - len(permitted)]


def reason_to_renew(
    leaf: Leaf | None, authority: CertificateAuthority, reachable: HostAddresses, clock: datetime.datetime
) -> str | None:
    """Why a leaf must be replaced, or None if it serves."""
    if leaf is None:
        return "there is none"
    if leaf.issuing != authority.issuing:
        return "another authority issued it"
    at = reference_time(clock, leaf.issued)
    if at < leaf.certificate.not_valid_before_utc:
        return f"it was issued on {leaf.issued:%Y-%m-%d}, after the clock's present time"
    if at > leaf.certificate.not_valid_after_utc - RENEW_BEFORE_END:
        return f"it ends on {leaf.certificate.not_valid_after_utc:%Y-%m-%d}"
    names, addresses = subjects(authority, reachable)
    missing = [*(set(names) - set(leaf.names)), *(set(addresses) - set(leaf.addresses))]
    if missing:
        return f"it lacks {', '.join(sorted(map(str, missing)))}"
    return None


def issue(
    authority: CertificateAuthority, reachable: HostAddresses, clock: datetime.datetime, before: Leaf | None = None
) -> Leaf:
    """A new leaf. It keeps the names and addresses of `before`, so that a laptop may go back and forth between networks."""
    at = reference_time(clock, before.issued if before else None)
    names, addresses = subjects(authority, reachable)
    if before is not None:
        names, addresses = (*names, *before.names), (*addresses, *before.addresses)
    alternatives = [
        *map(x509.DNSName, filter(authority.permits, dict.fromkeys(names))),
        *map(x509.IPAddress, filter(authority.permits, dict.fromkeys(addresses))),
    ]
    key = ec.generate_private_key(ec.SECP256R1())
    return Leaf(key, _certificate(authority, key, alternatives[:MAX_NAMES], at), authority.issuing)


def _certificate(
    authority: CertificateAuthority, key: ec.EllipticCurvePrivateKey, names: Iterable[x509.GeneralName], at: datetime.datetime
) -> x509.Certificate:
    key_usage = x509.KeyUsage(
        digital_signature=True,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=False,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )
    issuer = authority.issuing.public_key()
    assert isinstance(issuer, ec.EllipticCurvePublicKey)
    return (
        x509.CertificateBuilder()
        .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Lupin console")]))
        .issuer_name(authority.issuing.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(at - BEFORE_ISSUE)
        .not_valid_after(at + AFTER_ISSUE)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(key_usage, critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer), critical=False)
        .sign(authority.key, hashes.SHA256())
    )


def parse(data: bytes) -> Leaf | None:
    """The leaf of a file that `Leaf.pem` filled; None where it is damaged."""
    try:
        key = serialization.load_pem_private_key(data, None)
        certificate, issuing = x509.load_pem_x509_certificates(data)
        certificate.verify_directly_issued_by(issuing)
        certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except (ValueError, TypeError, UnsupportedAlgorithm, InvalidSignature, x509.ExtensionNotFound):
        return None
    if not isinstance(key, ec.EllipticCurvePrivateKey) or certificate.public_key() != key.public_key():
        return None
    return Leaf(key, certificate, issuing)
