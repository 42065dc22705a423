"""`release-key` on a real file: the first key is trusted as it is, a further one only on request."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations import OperationError
from lupin_cli.operations.release_key import ReleaseKey
from lupin_cli.release.signing_key import key_path, load_key
from tests.support.operation_cycle import apply, apply_and_undo, examine

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to whom the list of trusted keys belongs")


def use_operator(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / name))


def test_first_key_is_made_trusted_and_withdrawn(target: LocalTarget, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_operator("ada", tmp_path, monkeypatch)
    signers = tmp_path / "signers"
    operation = ReleaseKey(signers=str(signers))
    difference = examine(operation, target)
    assert difference is not None and load_key() is None, "a dry run makes no key"
    assert difference.summary == f"make a release key, {key_path()}, and trust it, the first one"
    apply_and_undo(operation, target)
    assert not signers.exists() and load_key() is not None
    apply(operation, target)
    key = load_key()
    assert key is not None and signers.read_text() == key.public.signers_line
    assert (signers.stat().st_uid, stat.S_IMODE(signers.stat().st_mode)) == (0, 0o644)


def test_further_key_needs_a_request_and_replaces_none(
    target: LocalTarget, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signers = tmp_path / "signers"
    use_operator("ada", tmp_path, monkeypatch)
    apply(ReleaseKey(signers=str(signers)), target)
    first = signers.read_text()
    signers.write_text(first.rstrip("\n"))  # as an editor may leave it
    use_operator("bob", tmp_path, monkeypatch)
    with pytest.raises(OperationError, match="yours is none of them") as refused:
        examine(ReleaseKey(signers=str(signers)), target)
    assert refused.value.next_command == "lupin deploy robot --trust-key"
    apply(ReleaseKey(signers=str(signers), further=True), target)
    key = load_key()
    assert key is not None and signers.read_text() == first + key.public.signers_line
    assert examine(ReleaseKey(signers=str(signers)), target) is None, "from now on it is trusted like the first one"


def test_damaged_own_key_stops_the_step(target: LocalTarget, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_operator("ada", tmp_path, monkeypatch)
    apply(ReleaseKey(signers=str(tmp_path / "signers")), target)
    key_path().write_text("half a k")
    with pytest.raises(OperationError, match="is damaged") as refused:
        examine(ReleaseKey(signers=str(tmp_path / "signers")), target)
    assert refused.value.next_command == f"mv {key_path()} {key_path()}.old"


def test_public_key_of_a_step_is_checked() -> None:
    with pytest.raises(ValueError, match="expected a public key"):
        ReleaseKey(key="ssh-rsa AAAA")
