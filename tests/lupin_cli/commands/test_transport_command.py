"""`lupin transport use` plays the transport's playbook with the operator's options."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pytest
from typer.models import ParameterInfo
from typer.testing import CliRunner

from lupin_cli.app import app
from lupin_cli.commands import play, transport
from lupin_cli.playbook import Result

ROBOTS = """
[robots.pot-1.addresses]
wired = "10.42.0.7:22"
[robots.pot-2.addresses]
router = "10.0.0.5"
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "lupin.toml"
    path.write_text(ROBOTS)
    return path


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What was played: the request, and the robots' names."""
    found: list[tuple[Any, ...]] = []

    def record(request: Any, robots: list[Any]) -> list[Result]:
        found.append((request, [robot.name for robot in robots]))
        return [Result(request.playbook.name, robot.name, "done") for robot in robots]

    monkeypatch.setattr(play, "_play_on_all", record)
    return found


def use(*words: str | Path) -> Any:
    return CliRunner().invoke(app, ["transport", "use", *map(str, words)])


def test_transport_is_used_with_the_robots_address(config: Path, played: list[tuple[Any, ...]]) -> None:
    done = use("wired", "--dry-run", "--robot", "pot-1", "--config", config)
    assert done.exit_code == 0, done.output
    ((request, robots),) = played
    assert (request.playbook.name, request.dry_run, robots) == ("demo-wired", True, ["pot-1"])
    assert request.variables == {"robot_ip": "10.42.0.7"}


def test_router_takes_its_key_from_a_hidden_file(config: Path, played: list[tuple[Any, ...]], tmp_path: Path) -> None:
    (tmp_path / "key").write_text("correct-horse\n")
    done = use("router", "-v", "ssid=hall", "--hidden", f"key={tmp_path}/key", "--robot", "pot-2", "--config", config)
    assert done.exit_code == 0, done.output
    assert played[0][0].variables == {"ssid": "hall", "key": "correct-horse", "robot_ip": "10.0.0.5"}


def test_error_for_a_missing_key_names_an_option_of_use(config: Path) -> None:
    done = use("router", "-v", "ssid=hall", "--robot", "pot-2", "--config", config)
    assert done.exit_code == 2 and "--hidden key" in done.output, done.output
    assert "--hidden" in use("--help").output


def test_transport_is_used_with_one_robot_at_a_time(config: Path, played: list[tuple[Any, ...]]) -> None:
    done = use("wired", "--robot", "pot-1", "--robot", "pot-2", "--config", config)
    assert done.exit_code == 2 and "name exactly one robot with --robot" in done.output and not played


@pytest.mark.parametrize("function", [play.command, transport.show])
def test_commands_that_others_call_have_plain_defaults(function: Any) -> None:
    defaults = [parameter.default for parameter in inspect.signature(function).parameters.values()]
    assert not [default for default in defaults if isinstance(default, ParameterInfo)]
