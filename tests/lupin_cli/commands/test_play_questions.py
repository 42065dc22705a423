"""The questions of a playbook on a terminal."""

from __future__ import annotations

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from lupin_cli.app import app
from lupin_cli.commands import play
from lupin_cli.commands.play import ProgressPrinter, ask_operator
from lupin_cli.connection import options


@pytest.mark.parametrize("typed", [True, False])
def test_question_on_a_terminal_is_answered_by_the_operator(monkeypatch: pytest.MonkeyPatch, typed: bool) -> None:
    asked: list[str] = []
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(play, "confirm", lambda question: asked.append(question) or typed)  # type: ignore[func-returns-value]
    answer = ask_operator(False, ProgressPrinter(quiet=True, several=False, diff=False))
    assert [answer("Reboot?"), answer("Stop?")] == [typed, typed]
    assert asked == ["Reboot?", "Stop?"]


@pytest.mark.parametrize("yes", [True, False])
def test_question_without_a_terminal_is_answered_by_the_option(monkeypatch: pytest.MonkeyPatch, yes: bool) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    assert ask_operator(yes, ProgressPrinter(quiet=True, several=False, diff=False))("Reboot?") is yes


def test_sudo_passwords_are_asked_before_the_threads_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "lupin.toml"
    path.write_text("".join(f'[robots.{name}.addresses]\nwired = "10.0.0.1"\n' for name in ("a", "b", "c")))
    asked: list[tuple[str, bool]] = []
    got: dict[str, Any] = {}

    def ask(prompt: str) -> str:
        asked.append((prompt, threading.current_thread() is threading.main_thread()))
        return f"secret of {prompt[-3]}"

    def open_target(robot: Any, _config: Any, *, sudo_password: str) -> Any:
        got[robot.name] = sudo_password
        return SimpleNamespace(name=robot.name, close=lambda: None)

    monkeypatch.setattr(options, "is_interactive", lambda: True)
    monkeypatch.setattr("getpass.getpass", ask)
    monkeypatch.setattr(options, "open_target", open_target)
    monkeypatch.setattr("lupin_cli.playbook.play", lambda book, targets, *_, **__: play_nothing(book, targets))
    done = CliRunner().invoke(app, ["play", "heal", "--all", "-K", "--config", str(path)])
    assert done.exit_code == 0, done.output
    assert asked == [(f"sudo password on {name}: ", True) for name in "abc"]
    assert got == {name: f"secret of {name}" for name in "abc"}


def play_nothing(book: Any, targets: dict[str, Any]) -> Any:
    from lupin_cli.playbook import Result

    return Result(book.name, targets["robot"].name, "done")
