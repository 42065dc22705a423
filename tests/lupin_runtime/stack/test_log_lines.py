"""Lines of logs: their times and levels, their order over processes, and the cause of an exit."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.stack.log_lines import LEVELS, LogLine, LogParser, cause_in_log, merged


def test_line_of_a_node_has_time_level_and_node() -> None:
    line = LogParser("nav").parse("[WARN] [1795515362.250000000] [slam_toolbox.sub]: a [b]: c")
    assert line == LogLine("nav", "a [b]: c", "slam_toolbox.sub", 1795515362.25, "warn", continues=False)


@pytest.mark.parametrize("text", ["", "Traceback", "[WARN] [x] [n]: t", "[LOUD] [1.0] [n]: t", "[INFO] [1] [n]: t"])
def test_other_lines_belong_to_the_line_before(text: str) -> None:
    parser = LogParser("nav")
    assert parser.parse(text) == LogLine("nav", text)
    before = parser.parse("[ERROR] [5.5] [n]: t")
    after = parser.parse(text)
    assert (after.text, after.time_s, after.level, after.continues) == (text, before.time_s, "error", True)


@given(st.lists(st.lists(st.one_of(st.none(), st.integers(0, 50)), max_size=12), max_size=4))
def test_merging_keeps_every_line_and_the_order_of_a_process(times: list[list[int | None]]) -> None:
    logs = []
    for number, one in enumerate(times):
        parser = LogParser(str(number))
        logs.append([parser.parse(f"{i}" if t is None else f"[INFO] [{t}.0] [n]: {i}") for i, t in enumerate(one)])
    result = merged(logs)
    assert len(result) == sum(map(len, logs))
    for number, log in enumerate(logs):
        assert [line for line in result if line.process == str(number)] == log
    if all(t is not None for one in times for t in one) and all(one == sorted(one) for one in times):  # type: ignore[type-var]
        assert [line.time_s for line in result] == sorted(line.time_s for log in logs for line in log)


def test_level_is_compared_by_its_rank() -> None:
    assert [LogLine("p", "", level="warn").is_at_least(level) for level in LEVELS] == [True, True, True, False, False]
    assert all(LogLine("p", "").is_at_least(level) for level in LEVELS)


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        ("[INFO] [1.0] [n]: fine\nTraceback (most recent call last):\n  File\nValueError: seed < 0\n", "ValueError: seed < 0"),
        ("a.b.BrokenError\n[INFO] [1.0] [n]: stopping\n", "a.b.BrokenError"),
        ("[ERROR] [1.0] [n]: no camera\n[INFO] [2.0] [n]: stopping\n", "no camera"),
        ("usage: sim\nsim: error: unknown world\n[INFO] [2.0] [n]: bye\n", "sim: error: unknown world"),
        ("[INFO] [1.0] [n]: fine\n", ""),
        ("", ""),
        (b"\xff\xfe\n", "\ufffd\ufffd"),
        ("x" * 100_000, "x" * 300),
    ],
)
def test_cause_of_an_exit_is_in_the_end_of_the_log(tmp_path: Path, content: str | bytes, cause: str) -> None:
    path = tmp_path / "nav.log"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert cause_in_log(path) == cause


def test_missing_log_names_no_cause(tmp_path: Path) -> None:
    assert cause_in_log(tmp_path / "none.log") == ""
