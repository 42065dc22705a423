"""Results of runs as lines for a terminal."""

from __future__ import annotations

import time
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.run.results import result_lines, results_table, short_ids, started_text, summary_of
from lupin_runtime.stack.results import RunResult

DONE = RunResult("20261124-191500-8679", "DONE", "", "random:9012", 1.8e9, 403.4, 10, 10, "/r/report.html")
LOST = replace(DONE, id="20261124-181500-51d7", state="NEVER_UP", why="sim exited with status 1: ValueError", tags_read=None)


@given(st.lists(st.from_regex(r"2026112[0-9]-[0-9a-f]{1,3}", fullmatch=True), unique=True, max_size=8))
def test_short_id_names_only_its_run(ids: list[str]) -> None:
    for full, short in short_ids(ids).items():
        assert short in full
        assert short == full or [one for one in ids if short in one] == [full]


def test_table_has_a_line_for_each_run_in_columns() -> None:
    head, first, second = [line.plain for line in results_table([DONE, LOST], {LOST.id})]
    assert head.split() == ["run", "started", "world", "result", "tags", "read", "duration", "why"]
    assert first.startswith("✓ 8679  ") and "done" in first and "10 of 10" in first and first.endswith("6:43")
    assert second.startswith("✗ 51d7  ") and "never up" in second
    assert second.endswith("6:43  kept, sim exited with status 1: ValueError")
    assert first.index("done") == second.index("never up") == head.index("result")
    assert summary_of([DONE, LOST, DONE]) == "3 runs, newest first: 2 done, 1 never up"


def test_start_has_its_date_unless_it_is_today() -> None:
    assert started_text(DONE, 1.8e9 + 1) == time.strftime("%H:%M", time.localtime(1.8e9))
    assert started_text(DONE, 1.8e9 + 1e6) == time.strftime("%Y-%m-%d %H:%M", time.localtime(1.8e9))
    assert started_text(replace(DONE, started_s=1e300)) == started_text(replace(DONE, started_s=None)) == "?"


def test_lines_of_a_result_state_its_reason_once() -> None:
    text = "\n".join(result_lines(LOST))
    assert text.count("ValueError") == 1 and "never up after 6:43" in text and "/r/report.html" in text
    assert "10 of 10 tags read" in "\n".join(result_lines(DONE))
