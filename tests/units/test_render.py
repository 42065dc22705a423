"""The renderer of unit files: strict about names and values."""

from __future__ import annotations

import shlex
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli import units

GOOD = {"user": "mirte", "release": "/opt/lupin/current", "set_up": ["source /opt/ros/humble/setup.bash"]}


def command_of(text: str) -> str:
    """The shell command of an ExecStart=, undone as systemd.service(5) says: quotes, escapes, then % and $."""
    (line,) = [line for line in text.splitlines() if line.startswith("ExecStart=")]
    _, _, command = shlex.split(line.removeprefix("ExecStart="))
    return command.replace("%%", "%").replace("$$", "$")


SET_UP = ("source ~/.mirte_settings.sh", "source /opt/ros/humble/setup.bash", "source ~/mirte_ws/install/setup.bash")


def test_every_hole_of_every_unit_is_filled() -> None:
    made = {
        **units.robot_units("mirte", "/opt/lupin/current", SET_UP),
        "lupin-clock-sync.service": units.clock_sync_unit("10.42.0.2"),
    }
    assert set(made) == set(units.unit_names())
    for unit, text in made.items():
        assert units.variables_of(unit) <= set(units.VARIABLES)
        assert not units._HOLE.search(text)
    assert "User=mirte\n" in made["lupin-onboard.service"]
    assert command_of(made["lupin-auto-home.service"]).endswith(
        "exec /opt/lupin/current/venv/bin/python3 -m lupin_runtime.arm.auto_home"
    )


def test_the_set_up_lines_come_in_their_order_before_what_is_started() -> None:
    command = command_of(units.robot_units("mirte", "/opt/lupin/current", SET_UP)["lupin-onboard.service"])
    assert command.split("; ")[:-1] == list(SET_UP)


@pytest.mark.parametrize(
    ("change", "said"),
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
def test_a_wrong_variable_is_named_and_nothing_is_rendered(change: dict, said: str) -> None:
    variables = {**GOOD, **change}
    with pytest.raises(units.UnitError, match=said):
        units.render("lupin-onboard.service", {name: value for name, value in variables.items() if value is not None})


def test_an_unknown_unit_is_answered_with_those_there_are() -> None:
    with pytest.raises(units.UnitError, match=r"there are: lupin-auto-home\.service, .*lupin-onboard\.service"):
        units.render("lupin-cameras.service", GOOD)


WORDS = st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=20)


@given(st.lists(WORDS, min_size=1, max_size=3))
def test_whatever_a_set_up_line_says_reaches_the_shell_as_it_was_written(words: list[str]) -> None:
    line = f"printf '%s\\n' {' '.join(shlex.quote(word) for word in words)}"
    command = command_of(units.render("lupin-onboard.service", {**GOOD, "set_up": [line]}))
    assert command.startswith(f"{line}; exec ")


def test_the_shell_that_systemd_starts_sees_variables_percents_and_quotes_unchanged() -> None:
    line = """export GREETING="100% of $HOME's" && echo "$GREETING" '"'"""
    command = command_of(units.render("lupin-onboard.service", {**GOOD, "set_up": [line]}))
    said = subprocess.run(
        ["bash", "-c", command.rpartition("; ")[0]], env={"HOME": "/h"}, capture_output=True, text=True, timeout=10
    )
    assert said.stdout == "100% of /h's \"\n"
