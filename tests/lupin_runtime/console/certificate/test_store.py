"""The certificate files are created once, kept, repaired and renewed; files of other users are never used."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_runtime.console.certificate import CertificateError, CertificateStore
from tests.support.certificates import HostStore, reachable, utc
from tests.support.optional import present

AUTHORITY, SERVER = "authority.pem", "server.pem"


@pytest.fixture
def store(tmp_path: Path) -> HostStore:
    return HostStore(tmp_path / "certificate")


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_certificates_stay_the_same_in_the_next_run(store: HostStore) -> None:
    first = store.ensure()
    again = HostStore(store.folder).ensure()
    assert again.authority.sha256 == first.authority.sha256
    assert again.leaf.sha256 == first.leaf.sha256
    assert (first.renewed, again.renewed, again.notes) == ("there was none", None, ())


def test_keys_are_readable_by_their_owner_only(store: HostStore) -> None:
    before = os.umask(0)
    try:
        store.ensure()
    finally:
        os.umask(before)
    assert mode(store.folder) == 0o700
    assert {path.name: mode(path) for path in store.folder.iterdir()} == {
        "authority.pem": 0o600,
        "server.pem": 0o600,
        "lock": 0o600,
        "authority.crt": 0o600,
    }
    assert b"PRIVATE" not in store.root_path.read_bytes()


def test_peek_creates_nothing(store: HostStore) -> None:
    assert store.peek() is None
    assert not store.folder.exists()
    made = store.ensure()
    assert present(store.peek()).sha256 == made.authority.sha256


@pytest.mark.parametrize("kept_bytes", [0, 1, 100, 250, 1000, 1900])
def test_truncated_authority_is_replaced_with_a_note(store: HostStore, kept_bytes: int) -> None:
    first = store.ensure()
    store.authority_path.write_bytes(store.authority_path.read_bytes()[:kept_bytes])
    second = store.ensure()
    assert second.authority.sha256 != first.authority.sha256
    assert second.leaf.issuing == second.authority.issuing
    assert "was not usable" in second.notes[0] and "lupin console certificate" in second.notes[0]
    assert store.root_path.read_bytes() == second.authority.root_pem()
    assert store.ensure().notes == ()


@pytest.mark.parametrize("kept_bytes", [0, 100, 250, 1000, 1500])
def test_truncated_server_certificate_is_replaced(store: HostStore, kept_bytes: int) -> None:
    first = store.ensure()
    store.server_path.write_bytes(store.server_path.read_bytes()[:kept_bytes])
    second = store.ensure()
    assert second.authority.sha256 == first.authority.sha256
    assert second.leaf.sha256 != first.leaf.sha256
    assert "damaged" in second.notes[0]


def test_damage_to_any_byte_is_handled(store: HostStore) -> None:
    store.ensure()
    for path in (store.authority_path, store.server_path):
        content = path.read_bytes()
        for position in range(0, len(content), 97):
            path.write_bytes(content[:position] + b"\x00" + content[position + 1 :])
            store.ensure()
            path.write_bytes(content)


def test_key_of_another_authority_is_refused(store: HostStore, tmp_path: Path) -> None:
    store.ensure()
    other = HostStore(tmp_path / "other")
    other.ensure()
    key = other.authority_path.read_bytes().split(b"-----BEGIN CERT")[0]
    chain = store.authority_path.read_bytes().partition(b"-----BEGIN CERT")
    store.authority_path.write_bytes(key + chain[1] + chain[2])
    assert "its key does not belong to its certificate" in store.ensure().notes[0]


def test_certificate_of_replaced_authority_is_replaced(store: HostStore) -> None:
    first = store.ensure()
    second = store.ensure(new_authority=True)
    assert second.authority.sha256 != first.authority.sha256
    assert second.renewed == "another authority issued it"
    assert store.root_path.read_bytes() == second.authority.root_pem()


def test_missing_copy_of_the_root_is_written_again(store: HostStore) -> None:
    first = store.ensure()
    store.root_path.write_text("something else")
    second = store.ensure()
    assert store.root_path.read_bytes() == first.authority.root_pem() == second.authority.root_pem()


def test_readable_keys_are_protected_and_server_key_replaced(store: HostStore) -> None:
    first = store.ensure()
    store.folder.chmod(0o755)
    store.authority_path.chmod(0o644)
    store.server_path.chmod(0o640)
    second = store.ensure()
    assert second.authority.sha256 == first.authority.sha256
    assert second.leaf.sha256 != first.leaf.sha256
    assert "--new-authority" in second.notes[0] and "0644" in second.notes[0]
    assert (mode(store.folder), mode(store.authority_path), mode(store.server_path)) == (0o700, 0o600, 0o600)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to give files away")
def test_authority_file_of_another_user_is_not_trusted(store: HostStore) -> None:
    first = store.ensure()
    os.chown(store.authority_path, 65534, 65534)
    second = store.ensure()
    assert second.authority.sha256 != first.authority.sha256
    assert "it belongs to user 65534" in second.notes[0]
    assert store.authority_path.stat().st_uid == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to give files away")
def test_folder_of_another_user_is_refused_and_left_alone(store: HostStore) -> None:
    store.ensure()
    before = {path.name: path.read_bytes() for path in store.folder.iterdir()}
    os.chown(store.folder, 65534, 65534)
    for action in (store.ensure, store.peek):
        with pytest.raises(CertificateError, match=r"belongs to user 65534.*without sudo"):
            action()
    assert {path.name: path.read_bytes() for path in store.folder.iterdir()} == before


@pytest.mark.parametrize("name", [AUTHORITY, SERVER])
def test_symbolic_link_is_replaced_and_its_target_left_alone(store: HostStore, tmp_path: Path, name: str) -> None:
    store.ensure()
    path, target = store.folder / name, tmp_path / "elsewhere"
    path.rename(target)
    content = target.read_bytes()
    path.symlink_to(target)
    assert "symbolic link" in store.ensure().notes[0]
    assert not path.is_symlink() and target.read_bytes() == content


@pytest.mark.parametrize("name", [AUTHORITY, SERVER])
def test_named_pipe_in_place_of_file_does_not_block(store: HostStore, name: str) -> None:
    store.ensure()
    (store.folder / name).unlink()
    os.mkfifo(store.folder / name, 0o600)
    assert "not a regular file" in store.ensure().notes[0]


def test_unwritable_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CertificateError, match=r"Not a directory.*XDG_STATE_HOME"):
        HostStore(tmp_path / "file" / "certificate").ensure()


def test_lock_held_by_another_process_is_reported(store: HostStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_runtime.console.certificate.store.LOCK_TIMEOUT_S", 0.1)
    with store._lock(), pytest.raises(CertificateError, match="another process"):
        store.ensure()


def test_concurrent_processes_use_the_same_certificates(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from lupin_runtime.console.certificate import CertificateStore\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        "made = CertificateStore(Path(sys.argv[1])).ensure(); print(made.authority.sha256, made.leaf.sha256)"
    )
    folder = tmp_path / "certificate"
    started = [
        subprocess.Popen([sys.executable, "-c", code, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    for process in started:
        assert present(process.stdout).readline() == "ready\n"
    for process in started:
        present(process.stdin).write("\n")
        present(process.stdin).flush()
    said = [process.communicate(timeout=60)[0] for process in started]
    made = CertificateStore(folder).ensure()
    assert set(said) == {f"{made.authority.sha256} {made.leaf.sha256}\n"}


def test_later_public_address_is_reported_as_omitted(store: HostStore) -> None:
    store.ensure()
    store.host_addresses = reachable("192.168.1.20", "145.94.1.2", names=("lab-7.local", "lab-7.example.nl", "greenhouse"))
    made = store.ensure()
    assert made.omitted == ("lab-7.example.nl", "145.94.1.2")
    assert "145.94.1.2" in map(str, store.ensure(new_authority=True).leaf.addresses)
    assert store.ensure().omitted == ()


def test_wrong_clock_is_reported(store: HostStore) -> None:
    store.now = utc(2022)
    assert "clock shows 2022-01-01" in store.ensure().notes[0]
    store.now = utc(2027)
    assert store.ensure().notes == ()
