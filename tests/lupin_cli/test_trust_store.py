"""The system's store, changed by the system's own program in a folder of the test."""

from __future__ import annotations

import shutil
import ssl
from pathlib import Path

import pytest

from lupin_cli.trust_store import TRUST_STORES, TrustStore, TrustStoreError, find_trust_store, instructions
from lupin_runtime.console.certificate import CertificateStore
from lupin_runtime.console.certificate.certificate_authority import CertificateAuthority

PROGRAM = "update-ca-certificates"


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> CertificateAuthority:
    return CertificateStore(tmp_path_factory.mktemp("state") / "certificate").ensure().authority


def store_in(folder: Path, program: str = PROGRAM) -> TrustStore:
    """Return Debian's store with all its folders below `folder`, and one other authority in it."""
    for name in ("local", "etc", "hooks", "public"):
        (folder / name).mkdir()
    other = CertificateStore(folder / "other").ensure().authority
    (folder / "public" / "other.crt").write_bytes(other.root_pem())
    (folder / "conf").write_text("other.crt\n")
    options = {"localcertsdir": "local", "etccertsdir": "etc", "hooksdir": "hooks", "certsdir": "public", "certsconf": "conf"}
    words = [word for option, name in options.items() for word in (f"--{option}", str(folder / name))]
    return TrustStore("Debian, Ubuntu", folder / "local", program, tuple(words), ("--fresh",))


@pytest.mark.skipif(shutil.which(PROGRAM, path="/usr/sbin:/usr/bin") is None, reason="no update-ca-certificates here")
def test_debians_program_puts_the_authority_into_the_bundle(tmp_path: Path, authority: CertificateAuthority) -> None:
    store, certificate = store_in(tmp_path), authority.root_pem()
    bundle = tmp_path / "etc" / "ca-certificates.crt"
    assert not store.holds(authority.id, certificate)
    store.add(authority.id, certificate)
    assert store.holds(authority.id, certificate) and certificate in bundle.read_bytes()
    assert authority.name in str(ssl.create_default_context(cafile=str(bundle)).get_ca_certs())
    store.remove(authority.id)
    assert not store.holds(authority.id, certificate) and certificate not in bundle.read_bytes()


def test_failing_program_leaves_the_store_as_it_was(tmp_path: Path, authority: CertificateAuthority) -> None:
    store, certificate = store_in(tmp_path, "false"), authority.root_pem()
    with pytest.raises(TrustStoreError, match="false exited with 1: it printed nothing"):
        store.add(authority.id, certificate)
    assert list(store.folder.iterdir()) == []
    store.path(authority.id).write_bytes(certificate)
    with pytest.raises(TrustStoreError, match="false exited with 1"):
        store.remove(authority.id)
    assert store.holds(authority.id, certificate)


def test_missing_program_and_folder_are_clear_errors(tmp_path: Path, authority: CertificateAuthority) -> None:
    store = store_in(tmp_path, "no-such-program")
    with pytest.raises(TrustStoreError, match="no-such-program is not installed"):
        store.add(authority.id, authority.root_pem())
    store.folder.rmdir()
    with pytest.raises(TrustStoreError, match="cannot be written: No such file"):
        store.add(authority.id, authority.root_pem())
    with pytest.raises(TrustStoreError, match="cannot be removed: No such file"):
        store.remove(authority.id)


def test_commands_for_root_change_the_same_file(tmp_path: Path) -> None:
    store = TRUST_STORES[0]
    assert store.add_command("1a2b3c4d", tmp_path / "a b.crt") == (
        f"sudo install -m 644 '{tmp_path}/a b.crt' /usr/local/share/ca-certificates/lupin-1a2b3c4d.crt "
        "&& sudo update-ca-certificates"
    )
    assert store.remove_command("1a2b3c4d") == (
        "sudo rm -f /usr/local/share/ca-certificates/lupin-1a2b3c4d.crt && sudo update-ca-certificates --fresh"
    )


def test_store_of_this_system_is_in_the_table() -> None:
    assert find_trust_store() in (None, *TRUST_STORES)


def test_instructions_name_the_file_in_each_command() -> None:
    for _, text in instructions("1a2b3c4d", "lupin.crt"):
        assert "lupin.crt" in text or not text.startswith(("sudo", "certutil"))
        assert "{" not in text
