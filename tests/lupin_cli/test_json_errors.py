"""With --json, an error is an object on standard output, whichever command fails and however."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lupin_cli.app import COMMANDS, app, main
from lupin_cli.json_errors import error_object

# Every command that reads lupin.toml and prints JSON.
READERS = [
    "bundle",
    "deploy robot",
    "doctor",
    "doctor --all",
    "play heal",
    "robots check",
    "robots list",
    "sweep",
    "sync-clock",
    "transport show",
    "wait",
    "wait free",
]


@pytest.mark.parametrize("words", READERS)
def test_broken_inventory_is_an_error_object(words: str, tmp_path: Path) -> None:
    inventory = tmp_path / "lupin.toml"
    inventory.write_text("default_robot = \n")
    done = CliRunner().invoke(app, [*words.split(), "--json", "--config", str(inventory)])
    error = json.loads(done.stdout)["error"]
    assert done.exit_code == error["exit_code"] == 2
    assert f"{inventory}:1: not valid TOML" in error["message"]


@pytest.mark.parametrize("words", [*COMMANDS, "nope"])
def test_wrong_option_is_an_error_object(words: str) -> None:
    done = CliRunner().invoke(app, [words, "--no-such-option", "--json"])
    error = json.loads(done.stdout)["error"]
    assert done.exit_code == error["exit_code"] != 0 and error["message"]


def test_unexpected_error_is_an_error_object(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["lupin", "journal", "list", "--json"])
    monkeypatch.setattr("lupin_cli.playbook.list_runs", lambda: 1 // 0)
    with pytest.raises(SystemExit) as exit_:
        main()
    error = json.loads(capsys.readouterr().out)["error"]
    assert exit_.value.code == error["exit_code"] == 70 and "ZeroDivisionError" in error["message"]


def test_output_of_a_failed_command_is_not_followed_by_an_object(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    done = CliRunner().invoke(app, ["dds", "check", "--json"])
    assert done.exit_code == 1 and isinstance(json.loads(done.stdout), list)


def test_error_object_has_message_and_next_command() -> None:
    printed = "asking mirte ...\nlupin play: mirte: no route\n  next: ip route get 10.42.0.1\n"
    assert error_object(printed, 3)["error"] == {
        "message": "lupin play: mirte: no route",
        "next_command": "ip route get 10.42.0.1",
        "exit_code": 3,
    }
