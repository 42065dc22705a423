"""What the authority permits, and that its key is useless elsewhere."""

from __future__ import annotations

import datetime
import ipaddress
import ssl
from dataclasses import replace
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec

from lupin_runtime.console.certificate import certificate_authority, leaf
from lupin_runtime.console.certificate.certificate_authority import CertificateAuthority, is_permittable
from tests.support.certificates import client_context, handshake, reachable

NOW = datetime.datetime.now(datetime.timezone.utc)
HOME = reachable("192.168.1.20", "145.94.1.2", names=("lab-7.local", "lab-7", "lab-7.example.nl"))
AUTHORITY = certificate_authority.create(HOME)


@pytest.mark.parametrize(
    ("subject", "permitted"),
    [
        ("localhost", True),
        ("lab-7.local", True),
        ("other.local", True),
        ("lab-7", True),
        ("lab-7.example.nl", True),
        ("example.nl", False),
        ("notlocal", False),
        ("google.com", False),
        ("127.0.0.1", True),
        ("10.1.2.3", True),
        ("145.94.1.2", True),
        ("145.94.1.3", False),
        ("1.1.1.1", False),
        ("::1", True),
        ("fd12::1", True),
        ("2001:db8::1", False),
    ],
)
def test_openssl_agrees_on_what_the_authority_permits(subject: str, permitted: bool, tmp_path: Path) -> None:
    name: str | ipaddress.IPv4Address | ipaddress.IPv6Address = subject
    general: x509.GeneralName = x509.DNSName(subject)
    if ":" in subject or subject.replace(".", "").isdigit():
        name = ipaddress.ip_address(subject)
        general = x509.IPAddress(name)
    assert AUTHORITY.permits(name) == permitted
    server = serve(tmp_path, stolen_key_signs(AUTHORITY, [general]))
    if permitted:
        assert handshake(server, client_context(AUTHORITY.root_pem()), subject).version() == "TLSv1.3"
    else:
        with pytest.raises(ssl.SSLCertVerificationError, match="permitted subtree violation"):
            handshake(server, client_context(AUTHORITY.root_pem()), subject)


def stolen_key_signs(authority: CertificateAuthority, names: list[x509.GeneralName]) -> leaf.Leaf:
    """Issue a certificate for any names, as a thief of the issuing key could."""
    key = ec.generate_private_key(ec.SECP256R1())
    issuer = authority.issuing.public_key()
    assert isinstance(issuer, ec.EllipticCurvePublicKey)
    certificate = (
        x509.CertificateBuilder(authority.issuing.subject, x509.Name([]), key.public_key(), x509.random_serial_number())
        .not_valid_before(NOW - datetime.timedelta(days=1))
        .not_valid_after(NOW + datetime.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName(names), critical=True)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer), critical=False)
        .sign(authority.key, hashes.SHA256())
    )
    return leaf.Leaf(key, certificate, authority.issuing)


def serve(folder: Path, identity: leaf.Leaf) -> ssl.SSLContext:
    path = folder / "server.pem"
    path.write_bytes(identity.pem())
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(path)
    return context


def test_stolen_key_cannot_make_another_authority(tmp_path: Path) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    issuer = AUTHORITY.issuing.public_key()
    assert isinstance(issuer, ec.EllipticCurvePublicKey)
    second = (
        x509.CertificateBuilder(
            AUTHORITY.issuing.subject, AUTHORITY.root.subject, key.public_key(), x509.random_serial_number()
        )
        .not_valid_before(certificate_authority.NOT_BEFORE)
        .not_valid_after(certificate_authority.NOT_AFTER)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .add_extension(AUTHORITY.issuing.extensions.get_extension_for_class(x509.KeyUsage).value, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer), critical=False)
        .sign(AUTHORITY.key, hashes.SHA256())
    )
    identity = stolen_key_signs(replace(AUTHORITY, key=key, issuing=second), [x509.DNSName("lab-7.local")])
    path = tmp_path / "server.pem"
    path.write_bytes(identity.pem() + AUTHORITY.pem().partition(b"-----END PRIVATE KEY-----\n")[2])
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(path)
    with pytest.raises(ssl.SSLCertVerificationError, match="path length constraint exceeded"):
        handshake(server, client_context(AUTHORITY.root_pem()), "lab-7.local")


@pytest.mark.parametrize(("certificate", "path_length"), [(AUTHORITY.root, 1), (AUTHORITY.issuing, 0)])
def test_each_certificate_is_limited_to_its_purpose(certificate: x509.Certificate, path_length: int) -> None:
    basic = certificate.extensions.get_extension_for_class(x509.BasicConstraints)
    usage = certificate.extensions.get_extension_for_class(x509.KeyUsage)
    constraints = certificate.extensions.get_extension_for_class(x509.NameConstraints)
    assert basic.critical and usage.critical and constraints.critical
    assert (basic.value.ca, basic.value.path_length) == (True, path_length)
    assert usage.value.key_cert_sign and not usage.value.digital_signature and not usage.value.crl_sign


def test_root_key_is_stored_nowhere() -> None:
    assert AUTHORITY.root.public_key() != AUTHORITY.key.public_key()
    assert AUTHORITY.pem().count(b"PRIVATE KEY") == 2  # one key: its first and its last line


def test_parse_returns_what_was_stored() -> None:
    again = certificate_authority.parse(AUTHORITY.pem())
    assert (again.pem(), again.name, again.id) == (AUTHORITY.pem(), AUTHORITY.name, AUTHORITY.id)
    assert AUTHORITY.id in AUTHORITY.name and "lab-7" in AUTHORITY.name


def test_long_host_name_is_cut_and_the_id_stays() -> None:
    made = certificate_authority.create(reachable(names=(f"{'h' * 63}.local",)))
    assert len(made.name) == 64 and made.id in made.name
    assert certificate_authority.create(reachable(names=())).name.startswith("Lupin console (")


@pytest.mark.parametrize("text", ["", "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"])
def test_other_files_are_refused_as_authority(text: str) -> None:
    with pytest.raises(certificate_authority.DamagedAuthority):
        certificate_authority.parse(text.encode())


@pytest.mark.parametrize(("name", "may"), [("dev", False), ("xn--p1ai", False), ("lab-7", True), ("pc2", True), ("a.nl", True)])
def test_host_named_like_top_level_domain_is_not_permitted(name: str, may: bool) -> None:
    assert is_permittable(name) == may
    authority = certificate_authority.create(reachable(names=(name,)))
    assert authority.permits(f"www.{name}") == may
