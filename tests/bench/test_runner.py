"""The runner of the benchmarks: options, table, JSON line, exit status, and what it makes of every benchmark."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import pytest

from bench.__main__ import load_benchmarks, run
from bench.runner import Benchmark, Figures, Log, Only, Patterns, benchmark, read_options


def measuring(figures: Figures | None) -> Benchmark:
    @benchmark(at_most={"delay_ms": 10.0, "slow.*.delay_ms": 20.0}, at_least={"rate_hz": 30.0})
    def main() -> Figures | None:
        return figures

    return main


def options(
    *worlds: Annotated[str, "worlds"],
    seconds: Annotated[float, "for this long, in 100 % of the cases"] = 10.0,
    by: Annotated[str, "who presses", ("button", "console")] = "button",
    list_: Annotated[bool, "list only"] = False,
    only: Only = "",
    patterns: Patterns = (),
    log: Log = None,
) -> None:
    """Has one parameter of each kind."""


def test_parameters_become_options() -> None:
    words = ["demo", "walled", "--seconds", "3", "--by", "console", "--list", "--only", "a|b", "--patterns", "x"]
    positional, named = read_options(options, [*words, "--patterns", "y", "--log", "f"], "bench", "")
    assert positional == ["demo", "walled"]
    expected = {"seconds": 3.0, "by": "console", "list_": True, "only": "a|b", "patterns": ("x", "y"), "log": Path("f")}
    assert named == expected
    defaults = {"seconds": 10.0, "by": "button", "list_": False, "only": "", "patterns": (), "log": None}
    assert read_options(options, [], "bench", "") == ([], defaults)


def test_help_has_texts_and_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        read_options(options, ["--help"], "bench", "What it measures.")
    text = " ".join(capsys.readouterr().out.split())
    assert "What it measures." in text
    assert "--seconds FLOAT for this long, in 100 % of the cases; default: 10.0" in text


def test_wrong_choice_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        read_options(options, ["--by", "hand"], "bench", "")
    assert "invalid choice: 'hand'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("figures", "status"),
    [
        ({"delay_ms": 10.0, "rate_hz": 30.0}, 0),
        ({"delay_ms": 10.1}, 1),
        ({"rate_hz": 29.9}, 1),
        ({"delay_ms": None}, 1),
        ({"unlimited": 5}, 0),
        ({"fast": {"a": {"delay_ms": 15.0}}}, 1),
        ({"slow": {"a": {"delay_ms": 15.0}}}, 0),
        ({"slow": {"a": {"delay_ms": 15.0, "met": False}}}, 1),
        ({"met": True}, 0),
        (None, 0),
    ],
)
def test_status_says_whether_all_limits_are_met(figures: Mapping[str, Any] | None, status: int) -> None:
    assert measuring(figures)([]) == status


def test_refusal_to_measure_is_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    @benchmark()
    def main() -> Figures:
        raise SystemExit("not measured: no camera")

    assert main([]) == 2
    assert capsys.readouterr().err == "not measured: no camera\n"


def test_defect_is_shown_and_is_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    @benchmark()
    def main() -> Figures:
        raise ValueError("no samples")

    assert main([]) == 2
    assert "Traceback" in (printed := capsys.readouterr().err) and "ValueError: no samples" in printed


def test_table_shows_limits_and_what_was_not_measured(capsys: pytest.CaptureFixture[str]) -> None:
    measuring({"delay_ms": 5.0, "slow": {"a": {"delay_ms": 30.0, "count": 2}, "b": {"count": 12345}}})([])
    assert capsys.readouterr().out.splitlines() == [
        f"{'delay_ms':40}          5  <= 10  met (0.50 of it)",
        "slow  delay_ms  count",
        "a           30      2  delay_ms <= 20  MISSED (1.50 of it)",
        "b               12345",
        f"{'rate_hz':40} not measured",
    ]


def test_json_is_one_line_with_figures_and_limits(capsys: pytest.CaptureFixture[str]) -> None:
    measuring({"rate_hz": 31.23456789})(["--json"])
    (line,) = capsys.readouterr().out.splitlines()
    expected = {"figures": {"rate_hz": 31.2346}, "limits": {"rate_hz": {"sign": ">=", "bound": 30.0, "met": True}}, "met": True}
    assert expected.items() <= json.loads(line).items()


@pytest.mark.parametrize("name", load_benchmarks())
def test_every_benchmark_has_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        load_benchmarks()[name](["--help"])
    assert f"usage: python -m bench.bench_{name} " in capsys.readouterr().out


def test_list_names_every_benchmark_and_its_limits(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(list_=True) == 0
    text = capsys.readouterr().out
    assert "\nmppi " in text and "overhead_ms <= 65" in text and "Takes hours." in text


def test_unknown_benchmark_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("no-such") == 2
    assert "unknown benchmark no-such; choose from: arm, cli, " in capsys.readouterr().err
