"""`lupin foxglove layout`, and `lupin up --foxglove` without the extra."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from lupin_cli.commands.up import _check_foxglove_extra
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR
from lupin_runtime.foxglove import extra
from lupin_runtime.foxglove.layout import LAYOUT


def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", "foxglove", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_layout_is_printed_as_it_is_shipped() -> None:
    done = lupin("layout")
    assert (done.returncode, done.stdout) == (0, LAYOUT.read_text(encoding="utf-8"))
    assert json.loads(done.stdout)["configById"]


def test_layout_is_written_to_a_file(tmp_path: Path) -> None:
    path = tmp_path / "lupin.json"
    done = lupin("layout", "--out", str(path))
    assert done.returncode == 0
    assert done.stdout.startswith(f"wrote {path}; import it")
    assert path.read_bytes() == LAYOUT.read_bytes()


def test_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    done = lupin("layout", "--out", str(tmp_path / "missing" / "lupin.json"))
    assert done.returncode == FAILURE
    assert "lupin.json: No such file or directory" in done.stderr


def test_up_refuses_foxglove_without_the_extra(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(extra, "is_installed", lambda: False)
    with pytest.raises(typer.Exit) as refused:
        _check_foxglove_extra()
    assert refused.value.exit_code == USAGE_ERROR
    stderr = capsys.readouterr().err
    assert stderr.startswith("lupin up: --foxglove: the extra lupin[foxglove] is not installed")
    assert f"{sys.executable} -m pip install 'foxglove-sdk" in stderr
