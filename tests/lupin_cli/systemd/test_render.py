"""Rendering of unit files: strict about names and values of variables."""

from __future__ import annotations

import shlex
import subprocess
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.systemd import units

VALID_VARIABLES = {"user": "mirte", "release": "/opt/lupin/current", "set_up": ["source /opt/ros/humble/setup.bash"]}


def parse_exec_start(text: str) -> str:
    """Return the shell command of a unit's ExecStart=, without systemd's quotes and its doubled % and $.

    For these units, shlex agrees with the quoting rules of systemd.service(5).
    """
    (line,) = [line for line in text.splitlines() if line.startswith("ExecStart=")]
    _, _, command = shlex.split(line.removeprefix("ExecStart="))
    return command.replace("%%", "%").replace("$$", "$")


SETUP_LINES = ("source ~/.mirte_settings.sh", "source /opt/ros/humble/setup.bash", "source ~/mirte_ws/install/setup.bash")


def test_every_template_has_a_row_and_symptoms() -> None:
    assert sorted(units.LUPIN_UNITS) == units.unit_names()
    assert all(unit.symptom and bool(unit.missing_symptom) == unit.in_release for unit in units.LUPIN_UNITS.values())


def test_all_placeholders_of_all_units_are_filled() -> None:
    rendered = {
        **units.robot_units("mirte", "/opt/lupin/current", SETUP_LINES),
        "lupin-clock-sync.service": units.clock_sync_unit("10.42.0.2"),
    }
    assert set(rendered) == set(units.unit_names())
    for unit, text in rendered.items():
        assert units.variables_of(unit) <= set(units.VARIABLES)
        assert not units._PLACEHOLDER.search(text)
    assert "User=mirte\n" in rendered["lupin-onboard.service"]
    assert parse_exec_start(rendered["lupin-auto-home.service"]).endswith(
        "exec /opt/lupin/current/venv/bin/python3 -m lupin_runtime.arm.auto_home --unattended"
    )


def test_setup_lines_precede_the_program_in_order() -> None:
    command = parse_exec_start(units.robot_units("mirte", "/opt/lupin/current", SETUP_LINES)["lupin-onboard.service"])
    assert command.split("; ")[:-1] == list(SETUP_LINES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"usr": "mirte"}, "unknown: usr"),
        ({"release": None}, "missing: release"),
        ({"user": "mirte\nExecStartPre=/bin/evil"}, "expected a user name"),
        ({"user": "%u"}, "expected a user name"),
        ({"release": "opt/lupin"}, "expected an absolute path"),
        ({"release": "/opt/my lupin"}, "expected an absolute path without spaces"),
        ({"set_up": "source x"}, "expected a list of shell lines"),
        ({"set_up": ["source x\nrm y"]}, "without line breaks"),
        ({"set_up": ["# a comment would swallow the rest"]}, "expected a whole shell command"),
        ({"set_up": ["source x \\"]}, "expected a whole shell command"),
        ({"set_up": [""]}, "expected a shell line"),
    ],
)
def test_invalid_variable_is_rejected_with_reason(change: dict[str, Any], message: str) -> None:
    variables = {**VALID_VARIABLES, **change}
    with pytest.raises(units.UnitError, match=message):
        units.render("lupin-onboard.service", {name: value for name, value in variables.items() if value is not None})


def test_unknown_unit_error_lists_known_units() -> None:
    with pytest.raises(units.UnitError, match=r"there are: lupin-auto-home\.service, .*lupin-onboard\.service"):
        units.render("lupin-voice.service", VALID_VARIABLES)


PRINTABLE_WORD = st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=20)


@given(st.lists(PRINTABLE_WORD, min_size=1, max_size=3))
def test_setup_line_reaches_the_shell_unchanged(words: list[str]) -> None:
    line = f"printf '%s\\n' {' '.join(shlex.quote(word) for word in words)}"
    command = parse_exec_start(units.render("lupin-onboard.service", {**VALID_VARIABLES, "set_up": [line]}))
    assert command.startswith(f"{line}; exec ")


def test_dollar_percent_and_quotes_survive_rendering() -> None:
    line = """export GREETING="100% of $HOME's" && echo "$GREETING" '"'"""
    command = parse_exec_start(units.render("lupin-onboard.service", {**VALID_VARIABLES, "set_up": [line]}))
    result = subprocess.run(
        ["bash", "-c", command.rpartition("; ")[0]], env={"HOME": "/h"}, capture_output=True, text=True, timeout=60
    )
    assert result.stdout == "100% of /h's \"\n"
