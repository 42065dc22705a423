"""`lupin console certificate`: what it shows, what it changes, and its exit status."""

from __future__ import annotations

import hashlib
import json
import os
import ssl
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from lupin_cli.commands.console_certificate import certificate
from lupin_cli.trust_store import TrustStore
from lupin_runtime.console.certificate import CertificateStore


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the certificates."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("SUDO_USER", raising=False)
    return tmp_path / "state" / "lupin" / "certificate"


def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", "console", "certificate", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def lupin_json(*arguments: str, status: int = 0) -> dict[str, Any]:
    done = lupin(*arguments, "--json")
    assert done.returncode == status, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_authority_is_created_once_and_described(state: Path) -> None:
    first, second = lupin_json(), lupin_json()
    assert (first["changed"], second["changed"]) == (True, False)
    assert first["authority"] == second["authority"] and first["server"]["sha256"] == second["server"]["sha256"]
    authority = first["authority"]
    path = Path(authority["path"])
    assert path.parent == state
    digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(path.read_text())).hexdigest()
    assert digest == authority["sha256"].replace(":", "").lower()
    assert "localhost" in first["server"]["names"] and "127.0.0.1" in first["server"]["addresses"]


def test_text_names_the_fingerprint_and_each_system() -> None:
    done = lupin()
    assert (done.returncode, done.stderr) == (0, "")
    for text in ("SHA-256", "valid", "Debian, Ubuntu", "Fedora", "macOS", "Windows", "Android", "iOS", "Firefox"):
        assert text in done.stdout


def test_dry_run_changes_nothing(state: Path) -> None:
    found = lupin_json("--dry-run")
    assert (found["authority"], found["dry_run"], found["changed"]) == (None, True, False)
    assert "is created" in found["messages"][0] and not state.exists()
    made = CertificateStore().ensure()
    before = {path.name: path.read_bytes() for path in state.iterdir()}
    for option in ("--install", "--new-authority", "--export=/proc/nothing"):
        found = lupin_json(option, "--dry-run")
        assert found["authority"]["sha256"] == made.authority.sha256 and not found["changed"]
    assert {path.name: path.read_bytes() for path in state.iterdir()} == before


def test_exported_file_is_the_trusted_certificate_without_a_key(tmp_path: Path) -> None:
    target = tmp_path / "lupin.crt"
    found = lupin_json("--export", str(target))
    assert found["changed"] and "PRIVATE" not in target.read_text()
    context = ssl.create_default_context(cafile=str(target))
    assert found["authority"]["name"] in str(context.get_ca_certs())


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--install", "--uninstall"), "choose one of --install and --uninstall"),
        (("--export", "/no/such/folder/x.crt"), "cannot be written: No such file or directory"),
        (("--export", "/"), "is a folder"),
        (("extra",), "extra"),
    ],
)
def test_usage_errors_exit_2(arguments: tuple[str, ...], text: str) -> None:
    done = lupin(*arguments)
    assert done.returncode == 2 and text in done.stderr and "Traceback" not in done.stderr


def test_unusable_state_folder_exits_4_with_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    done = lupin()
    assert done.returncode == 4 and "Not a directory" in done.stderr and "XDG_STATE_HOME" in done.stderr


def test_damaged_authority_is_reported_and_replaced(state: Path) -> None:
    first = lupin_json()
    (state / "authority.pem").write_text("gone")
    done = lupin()
    assert done.returncode == 0 and "note: the certificate authority" in done.stderr
    assert first["authority"]["sha256"] not in done.stdout


def test_new_authority_replaces_the_old_one() -> None:
    first, second = lupin_json(), lupin_json("--new-authority")
    assert second["changed"] and second["authority"]["sha256"] != first["authority"]["sha256"]
    assert first["authority"]["name"] in second["messages"][0]


@pytest.mark.skipif(os.geteuid() != 0, reason="sudo runs commands as root")
def test_certificates_are_not_made_for_root_under_sudo(state: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUDO_USER", "operator")
    done = lupin("--install")
    assert done.returncode == 2 and "run it as operator, without sudo" in done.stderr
    assert not state.exists()


class CommandRunner:
    """Runs the command in this process, with a trust store in a folder of the test."""

    def __init__(self, store: TrustStore, capsys: pytest.CaptureFixture[str]) -> None:
        self.store, self._capsys = store, capsys

    def run(self, **options: bool) -> tuple[int, dict[str, Any]]:
        """Return exit status and output of the command with `options`."""
        with pytest.raises(typer.Exit) as exited:
            certificate(
                **{"install": False, "uninstall": False, "new_authority": False, "dry_run": False, **options},
                export=None,
                as_json=True,
            )
        return exited.value.exit_code, json.loads(self._capsys.readouterr().out)


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> CommandRunner:
    folder = tmp_path / "anchors"
    folder.mkdir()
    store = TrustStore("Test", folder, "true")
    monkeypatch.setattr("lupin_cli.trust_store.find_trust_store", lambda: store)
    return CommandRunner(store, capsys)


def test_install_and_uninstall_are_idempotent(system: CommandRunner) -> None:
    status, found = system.run(install=True)
    assert (status, found["changed"], found["trusted_here"]) == (0, True, True)
    assert [path.name for path in system.store.folder.iterdir()] == [f"lupin-{found['authority']['name'][-9:-1]}.crt"]
    status, found = system.run(install=True)
    assert (status, found["changed"]) == (0, False) and "nothing to do" in found["messages"][0]
    for changed in (True, False):
        status, found = system.run(uninstall=True)
        assert (status, found["changed"], found["trusted_here"]) == (0, changed, False)
        assert list(system.store.folder.iterdir()) == []


def test_install_without_root_prints_the_command(system: CommandRunner, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TrustStore, "is_writable", lambda _: False)
    status, found = system.run(install=True)
    assert (status, found["trusted_here"]) == (1, False)
    path = found["authority"]["path"]
    assert found["command"].startswith(f"sudo install -m 644 {path} {system.store.folder}/lupin-")
    assert found["command"].endswith("&& sudo true")


def test_failed_install_is_reported_with_the_command(
    system: CommandRunner, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failing = TrustStore("Test", tmp_path / "anchors", "false")
    monkeypatch.setattr("lupin_cli.trust_store.find_trust_store", lambda: failing)
    status, found = system.run(install=True)
    assert status == 1 and "was not changed: false exited with 1" in found["messages"][0] and found["command"]


def test_system_without_a_known_store_is_reported(system: CommandRunner, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.trust_store.find_trust_store", lambda: None)
    status, found = system.run(install=True)
    assert (status, found["trusted_here"]) == (1, None) and "cannot change" in found["messages"][0]


def test_replaced_authority_is_named_if_it_is_still_trusted(system: CommandRunner) -> None:
    _, installed = system.run(install=True)
    old = installed["authority"]["name"][-9:-1]
    status, found = system.run(new_authority=True)
    assert (status, found["trusted_here"]) == (0, False)
    assert f"lupin-{old}.crt" in found["command"]
