"""The certificate authority: a root certificate that devices trust, and an issuing certificate that signs the server's.

The root signs the issuing certificate once; its key is then discarded and never stored in a file. The issuing certificate is
constrained to names and addresses of local networks, so a stolen issuing key is useless elsewhere. Constraints in the root
alone would not be enough, because verifiers may ignore them there (RFC 5280, 6.2).

Both certificates are valid for a fixed period that does not depend on the clock. A computer without a battery-backed clock may
create them while its clock is wrong, and devices that trust the root keep trusting it.
"""

from __future__ import annotations

import datetime
import hashlib
import ipaddress
from collections.abc import Iterable
from dataclasses import dataclass

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from lupin_runtime.console.host_addresses import Address, HostAddresses

NOT_BEFORE = datetime.datetime(2020, 1, 1, tzinfo=datetime.timezone.utc)
NOT_AFTER = datetime.datetime(2049, 12, 31, tzinfo=datetime.timezone.utc)  # the last year that UTCTime can express

Network = ipaddress.IPv4Network | ipaddress.IPv6Network

# Names that no public name server answers for: RFC 6761, 6762, 8375, and ICANN's reservation of .internal in 2024.
_LOCAL_DOMAINS = ("localhost", "local", "home.arpa", "internal")
_LOCAL_NETWORKS: tuple[Network, ...] = (
    *map(ipaddress.IPv4Network, ("127.0.0.0/8", "169.254.0.0/16", "100.64.0.0/10")),  # RFC 1122, 3927, 6598
    *map(ipaddress.IPv4Network, ("10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16")),  # RFC 1918
    *map(ipaddress.IPv6Network, ("::1/128", "fc00::/7")),  # RFC 4291, 4193
)
_MAX_COMMON_NAME = 64  # RFC 5280, ub-common-name


class DamagedAuthority(ValueError):
    """The stored authority is damaged or was not created by Lupin; the message gives details."""


@dataclass(frozen=True)
class CertificateAuthority:
    """The issuing key, its certificate, and the root that devices trust."""

    key: ec.EllipticCurvePrivateKey
    issuing: x509.Certificate
    root: x509.Certificate

    @property
    def name(self) -> str:
        """The name under which devices list the root."""
        return common_name(self.root)

    @property
    def id(self) -> str:
        """Eight hexadecimal digits, also part of the name, that distinguish it from other authorities."""
        return _key_id(self.root.public_key())

    @property
    def sha256(self) -> str:
        """The fingerprint of the root certificate."""
        return fingerprint(self.root)

    def permits(self, subject: str | Address) -> bool:
        """Return whether it may issue certificates for a DNS name or an address."""
        constraints = self.issuing.extensions.get_extension_for_class(x509.NameConstraints).value
        for subtree in constraints.permitted_subtrees or ():
            if isinstance(subject, str) and isinstance(subtree, x509.DNSName):
                if subject == subtree.value or subject.endswith(f".{subtree.value}"):
                    return True
            elif not isinstance(subject, str) and isinstance(subtree, x509.IPAddress):
                network = subtree.value
                if isinstance(network, Network) and subject.version == network.version and subject in network:
                    return True
        return False

    def root_pem(self) -> bytes:
        """Return the root certificate, which devices install."""
        return self.root.public_bytes(serialization.Encoding.PEM)

    def pem(self) -> bytes:
        """Return the issuing key and both certificates; this is secret."""
        return private_pem(self.key) + self.issuing.public_bytes(serialization.Encoding.PEM) + self.root_pem()


def create(reachable: HostAddresses) -> CertificateAuthority:
    """Create an authority for local names and networks, and for the host's current names and addresses.

    The current addresses may be public: some networks, such as universities', give their hosts public addresses, and a
    certificate without them would be useless there.
    """
    root_key, key = ec.generate_private_key(ec.SECP256R1()), ec.generate_private_key(ec.SECP256R1())
    suffix = f" ({_key_id(root_key.public_key())})"
    host = reachable.names[0].removesuffix(".local") if reachable.names else ""
    title = f"Lupin console{f' on {host}' if host else ''}"[: _MAX_COMMON_NAME - len(suffix)] + suffix
    root_name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, title), _ORGANIZATION])
    issuing_name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"Lupin console, issuing{suffix}"), _ORGANIZATION])
    subtrees = _permitted(reachable)
    root = _certificate(root_name, root_name, root_key, root_key, 1, subtrees)
    return CertificateAuthority(key, _certificate(issuing_name, root_name, key, root_key, 0, subtrees), root)


def parse(data: bytes) -> CertificateAuthority:
    """Read an authority from the output of `CertificateAuthority.pem`. Raises DamagedAuthority."""
    try:
        key = serialization.load_pem_private_key(data, None)
        issuing, root = x509.load_pem_x509_certificates(data)
        authority = _checked(key, issuing, root)
    except DamagedAuthority:
        raise
    except (ValueError, TypeError, UnsupportedAlgorithm, InvalidSignature, x509.ExtensionNotFound) as error:
        raise DamagedAuthority("it does not contain a key with its two certificates") from error
    return authority


def _checked(key: object, issuing: x509.Certificate, root: x509.Certificate) -> CertificateAuthority:
    if not isinstance(key, ec.EllipticCurvePrivateKey) or issuing.public_key() != key.public_key():
        raise DamagedAuthority("its key does not belong to its certificate")
    issuing.verify_directly_issued_by(root)
    root.verify_directly_issued_by(root)
    issuing.extensions.get_extension_for_class(x509.NameConstraints)
    return CertificateAuthority(key, issuing, root)


_ORGANIZATION = x509.NameAttribute(NameOID.ORGANIZATION_NAME, "Lupin")


def _permitted(reachable: HostAddresses) -> list[x509.GeneralName]:
    names = list(_LOCAL_DOMAINS)
    names += [name for name in reachable.names if is_permittable(name) and not name.endswith(tuple(f".{n}" for n in names))]
    networks = list(_LOCAL_NETWORKS)
    networks += [ipaddress.ip_network(address) for address in reachable.addresses if not _is_local(address)]
    return [*map(x509.DNSName, names), *map(x509.IPAddress, networks)]


def is_permittable(name: str) -> bool:
    """Return whether a host name cannot be a top-level domain, which would permit every site below it.

    Top-level domains consist of letters only (RFC 1123, 2.1), or begin with xn--.
    """
    return "." in name or (not name.isalpha() and not name.startswith("xn--"))


def _is_local(address: Address) -> bool:
    return any(address.version == network.version and address in network for network in _LOCAL_NETWORKS)


def _certificate(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    signing_key: ec.EllipticCurvePrivateKey,
    path_length: int,
    subtrees: Iterable[x509.GeneralName],
) -> x509.Certificate:
    key_usage = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(NOT_BEFORE)
        .not_valid_after(NOT_AFTER)
        .add_extension(x509.BasicConstraints(ca=True, path_length=path_length), critical=True)
        .add_extension(key_usage, critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.NameConstraints(permitted_subtrees=subtrees, excluded_subtrees=None), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signing_key.public_key()), critical=False)
        .sign(signing_key, hashes.SHA256())
    )


def common_name(certificate: x509.Certificate) -> str:
    """Return the subject's common name; empty if it has none."""
    found = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(found[0].value) if found else ""


def fingerprint(certificate: x509.Certificate) -> str:
    """Return a certificate's SHA-256 as hexadecimal bytes separated by colons, the form that systems show."""
    return certificate.fingerprint(hashes.SHA256()).hex(":").upper()


def private_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    """Return a key as PKCS #8, without a password, because the server starts unattended."""
    encoding, layout = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    return key.private_bytes(encoding, layout, serialization.NoEncryption())


def _key_id(key: object) -> str:
    assert isinstance(key, ec.EllipticCurvePublicKey)
    data = key.public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo)
    return hashlib.sha256(data).hexdigest()[:8]
