"""The server certificate, the leaf of the chain: its names, its validity, and when it must be replaced.

The host's clock may be wrong: a robot's computer has no battery-backed clock and boots with the time of its last shutdown or of
its disk image. Devices check the certificate against their own clocks. So its validity begins a month before it is issued, and
it is replaced as soon as the host's clock is outside its validity; a clock that is certainly wrong is not used.
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

# Browsers accept at most 398 days from public authorities, and Apple's at most 825 from any (support.apple.com/103214).
BEFORE_ISSUE = datetime.timedelta(days=31)
AFTER_ISSUE = datetime.timedelta(days=366)
RENEW_BEFORE_END = datetime.timedelta(days=31)

# A clock outside these times is certainly wrong: this file is newer than EARLIEST, and the authority expires in 2049.
EARLIEST = datetime.datetime(2026, 11, 1, tzinfo=datetime.timezone.utc)
LATEST = datetime.datetime(2048, 1, 1, tzinfo=datetime.timezone.utc)

MAX_NAMES = 64  # names and addresses in one certificate, including those from earlier networks


@dataclass(frozen=True)
class Leaf:
    """The server's key and certificate, and the issuing certificate, which the server sends too."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate
    issuing: x509.Certificate

    @property
    def sha256(self) -> str:
        """The fingerprint of the certificate."""
        return fingerprint(self.certificate)

    @property
    def issued(self) -> datetime.datetime:
        """The time when it was issued."""
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
        """Return the key and the certificate chain as TLS servers read them; this is secret."""
        chain = (self.certificate, self.issuing)
        return private_pem(self.key) + b"".join(one.public_bytes(serialization.Encoding.PEM) for one in chain)


def is_plausible(clock: datetime.datetime) -> bool:
    """Return whether a clock may be right."""
    return EARLIEST <= clock <= LATEST


def reference_time(clock: datetime.datetime, issued: datetime.datetime | None) -> datetime.datetime:
    """Return the time to use as now: the clock's or, if that is certainly wrong, the time when the last leaf was issued."""
    return clock if is_plausible(clock) else issued or EARLIEST


def subjects(authority: CertificateAuthority, reachable: HostAddresses) -> tuple[tuple[str, ...], tuple[Address, ...]]:
    """Return the names and addresses that a leaf must have: localhost and the host's, as far as the authority permits."""
    names = dict.fromkeys(("localhost", *reachable.names))
    addresses = dict.fromkeys((*LOOPBACK, *reachable.addresses))
    permitted = tuple(filter(authority.permits, names))
    return permitted, tuple(filter(authority.permits, addresses))[: MAX_NAMES - len(permitted)]


def reason_to_renew(
    leaf: Leaf | None, authority: CertificateAuthority, reachable: HostAddresses, clock: datetime.datetime
) -> str | None:
    """Return why a leaf must be replaced; None if it need not be."""
    if leaf is None:
        return "there was none"
    if leaf.issuing != authority.issuing:
        return "another authority issued it"
    at = reference_time(clock, leaf.issued)
    if at < leaf.certificate.not_valid_before_utc:
        return f"it was issued on {leaf.issued:%Y-%m-%d}, after the clock's current time"
    if at > leaf.certificate.not_valid_after_utc - RENEW_BEFORE_END:
        return f"it expires on {leaf.certificate.not_valid_after_utc:%Y-%m-%d}"
    names, addresses = subjects(authority, reachable)
    missing = [*(set(names) - set(leaf.names)), *(set(addresses) - set(leaf.addresses))]
    if missing:
        return f"it lacks {', '.join(sorted(map(str, missing)))}"
    return None


def issue(
    authority: CertificateAuthority, reachable: HostAddresses, clock: datetime.datetime, before: Leaf | None = None
) -> Leaf:
    """Issue a leaf. It keeps the names and addresses of `before`, so that a laptop can move between networks."""
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
    """Read a leaf from the output of `Leaf.pem`; None if it is damaged."""
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
