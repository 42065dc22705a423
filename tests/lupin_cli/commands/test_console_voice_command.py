"""`lupin console voice`: storing, describing and forgetting the key, which is never shown."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

KEY = "a-made-up-key-for-tests-0123456789"


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file of the key."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "lupin" / "console" / "voice_key"


def lupin(*arguments: str, typed: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lupin_cli.app", "console", "voice", *arguments]
    done = subprocess.run(command, input=typed, capture_output=True, text=True, timeout=60, check=False)
    assert KEY not in done.stdout + done.stderr
    return done


def test_key_is_stored_described_and_forgotten(state: Path) -> None:
    missing = lupin("status")
    assert missing.returncode == 1 and "lupin console voice set-key" in missing.stdout
    assert lupin("set-key", typed=f"{KEY}\n").returncode == 0
    assert state.read_text() == f"{KEY}\n" and state.stat().st_mode & 0o777 == 0o600
    assert json.loads(lupin("status", "--json").stdout) == {"stored": True, "path": str(state)}
    assert "would delete" in lupin("forget", "--dry-run").stdout and state.exists()
    assert lupin("forget").returncode == 0 and not state.exists()
    assert lupin("forget").returncode == 0


def test_key_is_no_argument(state: Path) -> None:
    refused = lupin("set-key", "something-else-that-others-could-see")
    assert refused.returncode == 2 and not state.exists()


@pytest.mark.parametrize("typed", ["", "short\n", "two words that are long enough for it\n"])
def test_text_that_is_no_key_is_not_stored(state: Path, typed: str) -> None:
    refused = lupin("set-key", typed=typed)
    assert refused.returncode == 2 and "nothing was stored" in refused.stderr
    assert not state.exists()


def test_file_that_others_may_read_is_named(state: Path) -> None:
    lupin("set-key", typed=KEY)
    state.chmod(0o640)
    described = lupin("status")
    assert described.returncode == 2 and str(state) in described.stderr
