"""`lupin sync-clock`: which clock it trusts, what it reports of several robots, and of a journal that cannot be written."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from lupin_cli.app import app
from lupin_cli.commands import sync_clock
from lupin_cli.connection.base import Output, Script, Unreachable
from lupin_cli.connection.local import LocalTarget
from lupin_cli.exit_codes import FAILURE
from lupin_cli.facts.clock import Offset
from lupin_cli.link.clock_offset import OffsetEstimate
from lupin_cli.playbook import JournalError, engine, play
from lupin_cli.playbook.results import Result

REFUSING = "check-laptop-clock / Require a laptop whose clock can be trusted"


class RobotWithClock(LocalTarget):
    """This machine as a robot whose clock is `ahead_s` of this machine's, and whose chrony does not run."""

    def __init__(self, ahead_s: float) -> None:
        super().__init__("robot")
        self._ahead_s = ahead_s

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        found = super().batch(scripts, timeout_s)
        if "clock" in found:
            found["clock"] = Output(0, f"{float(found['clock'].stdout) + self._ahead_s:.6f}\n")
        return found


@pytest.fixture
def laptop_without_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Nothing disciplines this machine's clock, as far as it says; the function sets what timedatectl says."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))

    def install(name: str, text: str) -> None:
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)

    install("pidof", "exit 1")
    return lambda answer: install("timedatectl", f"echo {answer}")


def plan(playbook: str, ahead_s: float, **variables: Any) -> Result:
    """Return the dry run of a playbook: it ends before the first step that would change something, or behind it."""
    return play(playbook, {"robot": RobotWithClock(ahead_s), "laptop": LocalTarget()}, variables, dry_run=True)


@pytest.mark.parametrize("playbook", ["sync-clock", "install-clock-sync"])
def test_robot_ahead_of_an_unsynchronized_laptop_is_left_alone(
    laptop_without_source: Callable[[str], None], playbook: str
) -> None:
    laptop_without_source("no")
    refused = plan(playbook, 400.0)
    assert refused.state == "failed" and refused.message.startswith(REFUSING), refused.message
    assert "the robot's clock shows 2" in refused.message and ", this machine's 2" in refused.message
    assert refused.changed == 0 and "trust" in refused.next_command and "--robot robot" in refused.next_command
    assert not plan(playbook, 400.0, trust_laptop=True).message.startswith(REFUSING)
    assert not plan(playbook, -400.0).message.startswith(REFUSING), "it was off"
    laptop_without_source("yes")
    assert not plan(playbook, 400.0).message.startswith(REFUSING)


def test_override_repeats_the_variables_that_were_given(laptop_without_source: Callable[[str], None]) -> None:
    laptop_without_source("no")
    refused = plan("sync-clock", 400.0, tolerance_s=1.0, controllers=False)
    words = "-v tolerance_s=1.0 -v controllers=false -v trust_laptop=true"
    assert refused.next_command == f"lupin play sync-clock --robot robot {words}"
    request = sync_clock._Request(True, False, False, False, "ada@desk", False, True)
    assert request.override("pot") == (
        "lupin sync-clock --robot pot --install --trust-laptop --ask-sudo-password --break-lease ada@desk"
    )


def status(offset_s: float, stack: str = "active") -> sync_clock.ClockStatus:
    return sync_clock.ClockStatus(OffsetEstimate(Offset(offset_s, 0.001), 0.002, 60, True), None, stack)


@pytest.fixture
def robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, float | None]:
    """Robots `a` and `b`, by the offset of their clocks in s; None if one cannot be reached. Both clocks are right."""
    offsets: dict[str, float | None] = {"a": 0.0, "b": 0.0}
    (tmp_path / "lupin.toml").write_text("".join(f'[robots.{name}.addresses]\nwired = "10.0.0.1"\n' for name in offsets))

    @contextmanager
    def connect(robot: Any, _inventory: Any, **_options: Any) -> Iterator[Any]:
        if offsets[robot.name] is None:
            raise Unreachable(f"{robot.name}: nothing answers", "timeout", "ping -c 3 10.0.0.1")
        yield SimpleNamespace(name=robot.name, login_command=f"ssh {robot.name}")

    monkeypatch.setattr(sync_clock, "connect", connect)
    monkeypatch.setattr(sync_clock, "inspect", lambda target: status(offsets[target.name] or 0.0))
    monkeypatch.setenv("LUPIN_CONFIG", str(tmp_path / "lupin.toml"))
    return offsets


def run(*words: str) -> Any:
    return CliRunner().invoke(app, ["sync-clock", *words])


def test_several_robots_are_one_json_document(robots: dict[str, float | None]) -> None:
    done = run("--robot", "a", "--robot", "b", "--json")
    assert [report["robot"] for report in json.loads(done.stdout)] == ["a", "b"] and done.exit_code == 0
    assert json.loads(run("--robot", "a", "--json").stdout)["done"] == "nothing"
    robots["a"] = None
    done = run("--robot", "a", "--robot", "b", "--json")
    first, second = json.loads(done.stdout)
    assert first["error"] == {"message": "a: nothing answers", "next_command": "ping -c 3 10.0.0.1", "exit_code": 3}
    assert second["done"] == "nothing" and done.exit_code == 3


@pytest.mark.parametrize(("offset_s", "options", "code"), [(100.0, (), 1), (100.0, ("--dry-run",), 0), (0.0, (), 0)])
def test_resume_without_a_run_fails_if_the_clock_is_wrong(
    robots: dict[str, float | None], monkeypatch: pytest.MonkeyPatch, offset_s: float, options: tuple[str, ...], code: int
) -> None:
    robots["a"] = offset_s
    nothing = Result("sync-clock", "a", "done", message="there is no unfinished run of sync-clock")
    monkeypatch.setattr(sync_clock, "_play", lambda *_: nothing)
    done = run("--robot", "a", "--resume", *options)
    assert done.exit_code == code, done.output
    assert ("next: lupin sync-clock --robot a" in done.output) == (code == 1)


@pytest.mark.parametrize("options", [(), ("--install",)])
def test_impossible_time_is_not_given_to_the_robot(
    robots: dict[str, float | None], monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    robots["a"] = 1.7e9
    monkeypatch.setattr("lupin_cli.commands.sync_clock.time.time", lambda: 240.0)
    done = run("--robot", "a", "--json", *options)
    assert done.exit_code == FAILURE and json.loads(done.stdout)["done"] == "nothing"
    assert "this machine's clock is wrong: it shows 1970-01-01 00:04 UTC" in done.stderr
    assert "next: sudo timedatectl set-ntp true" in done.stderr and "do: if no time source answers" in done.stderr


@pytest.mark.usefixtures("robots")
def test_journal_error_still_reports_that_the_stack_is_down(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_arguments: object, **_options: object) -> None:
        raise JournalError("the journal cannot be written in /state: No space left on device", "df -h /state")

    monkeypatch.setattr(engine, "play", refuse)
    monkeypatch.setattr(sync_clock, "inspect", lambda _target: status(100.0, "inactive"))
    done = run("--robot", "a", "--json")
    assert "No space left on device" in done.stderr and "a: THE STACK IS DOWN" in done.stderr, done.stderr
    report = json.loads(done.stdout)
    assert (report["state"], report["after"]["stack"], done.exit_code) == ("failed", "inactive", FAILURE)
