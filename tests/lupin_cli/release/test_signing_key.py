"""The operator's release key: made once, private, and compatible with OpenSSH."""

from __future__ import annotations

import stat
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from lupin_cli.release.signing_key import PublicKey, SigningKeyError, ensure_key, key_path, load_key
from lupin_cli.release.verify_release import NAMESPACE, SIGNER


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


def test_key_is_made_once_and_only_its_owner_reads_it() -> None:
    assert load_key() is None
    first = ensure_key().public
    assert ensure_key().public == first
    assert stat.S_IMODE(key_path().stat().st_mode) == 0o600 and stat.S_IMODE(key_path().parent.stat().st_mode) == 0o700
    assert [path.name for path in key_path().parent.iterdir()] == ["release-key"]


def test_deploys_at_the_same_time_make_one_key() -> None:
    with ThreadPoolExecutor(8) as pool:
        keys = {future.result().public for future in [pool.submit(ensure_key) for _ in range(8)]}
    assert len(keys) == 1


def test_openssh_reads_the_key_and_verifies_its_signature(tmp_path: Path) -> None:
    key = ensure_key()
    printed = subprocess.run(["ssh-keygen", "-lf", key_path()], capture_output=True, text=True, check=True).stdout
    assert key.public.fingerprint in printed
    (tmp_path / "signers").write_text(key.public.signers_line)
    (tmp_path / "text.sig").write_bytes(key.sign(b"text"))
    command = ["ssh-keygen", "-Y", "verify", "-f", "signers", "-I", SIGNER, "-n", NAMESPACE, "-s", "text.sig"]
    for text, status in ((b"text", 0), (b"other text", 255)):
        assert subprocess.run(command, input=text, capture_output=True, cwd=tmp_path, timeout=60).returncode == status


def test_public_key_is_read_from_its_lines() -> None:
    key = ensure_key().public
    for line in (key.signers_line, f"ssh-ed25519 {key.encoded} {key.comment}\n"):
        assert PublicKey.parse(line) == key
    for line in ("", "# " + key.signers_line, "ssh-rsa AAAA", "ssh-ed25519 ???"):
        with pytest.raises(ValueError, match="expected a public key"):
            PublicKey.parse(line)


def test_key_that_others_may_read_is_refused_with_a_command() -> None:
    ensure_key()
    key_path().chmod(0o644)
    with pytest.raises(SigningKeyError, match="other users may read the release key") as refused:
        ensure_key()
    assert refused.value.next_command == f"chmod 600 {key_path()}"


@pytest.mark.parametrize("content", ["", "half a k", "-----BEGIN OPENSSH PRIVATE KEY-----\nAAAA\n"])
def test_damaged_key_is_not_replaced_silently(content: str) -> None:
    ensure_key()
    key_path().write_text(content)
    with pytest.raises(SigningKeyError, match="is damaged") as refused:
        ensure_key()
    assert refused.value.next_command.startswith("mv ") and key_path().read_text() == content


def test_key_of_another_type_is_refused() -> None:
    ensure_key()
    key_path().unlink()
    subprocess.run(["ssh-keygen", "-q", "-t", "ecdsa", "-N", "", "-f", key_path()], check=True)
    with pytest.raises(SigningKeyError, match="is not an Ed25519 key"):
        ensure_key()
