"""The results of runs as lines for a terminal: a table of many, and a block about one."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection, Sequence

from rich.text import Text

from lupin_cli.terminal import minutes
from lupin_runtime.stack.results import DONE, INTERRUPTED, NO_RESULT, UP, RunResult

# Mark and style of a result; every other state is a failure.
MARKS = {DONE: ("✓", "green"), UP: (">", "cyan"), INTERRUPTED: ("!", "yellow"), NO_RESULT: ("✗", "red")}
FAILED_MARK = ("✗", "red")
_NUMBERS = (4, 5)  # columns


def word_of(result: RunResult) -> str:
    """Return the result in a word or two, such as done, never up or no result."""
    return result.state.lower().replace("_", " ")


def short_ids(ids: Sequence[str]) -> dict[str, str]:
    """Return for every id the part that a person types: its random end, or all of it if another id contains that."""
    ends = {one: one.rpartition("-")[2] for one in ids}
    return {one: end if end and sum(end in other for other in ids) == 1 else one for one, end in ends.items()}


def summary_of(results: Sequence[RunResult]) -> str:
    """Return how many runs there are and how they ended."""
    counts = Counter(word_of(result) for result in results)
    noun = "run" if len(results) == 1 else "runs"
    return f"{len(results)} {noun}, newest first: {', '.join(f'{count} {word}' for word, count in counts.most_common())}"


def results_table(results: Sequence[RunResult], kept: Collection[str] = ()) -> list[Text]:
    """Return a headline and a line for each result; runs whose id is in `kept` are marked so."""
    names = short_ids([result.id for result in results])
    rows = [("run", "started", "world", "result", "tags read", "duration", "why")]
    rows += [
        (
            names[result.id],
            started_text(result),
            result.world or "?",
            word_of(result),
            _tags(result),
            minutes(result.duration_s) if result.duration_s is not None else "",
            ", ".join(part for part in ("kept" if result.id in kept else "", result.why) if part),
        )
        for result in results
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    lines = []
    for row, result in zip(rows, (None, *results), strict=True):
        mark, style = (" ", "dim") if result is None else MARKS.get(result.state, FAILED_MARK)
        cells = [
            cell.rjust(width) if column in _NUMBERS else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths))
        ]
        text = "  ".join((*cells, row[-1])).rstrip()
        lines.append(Text.assemble((mark, style), " ", (text, "dim" if result is None else "")))
    return lines


def _tags(result: RunResult) -> str:
    return f"{result.tags_read} of {result.tags_total}" if None not in (result.tags_read, result.tags_total) else ""


def started_text(result: RunResult, now_s: float | None = None) -> str:
    """Return when a run started: the time of day, before it the date unless it is today's."""
    if result.started_s is None:
        return "?"
    try:
        started, today = time.localtime(result.started_s), time.localtime(now_s)
    except (OverflowError, ValueError, OSError):
        return "?"  # a damaged file
    is_today = (started.tm_year, started.tm_yday) == (today.tm_year, today.tm_yday)
    return time.strftime("%H:%M" if is_today else "%Y-%m-%d %H:%M", started)


def result_lines(result: RunResult) -> list[str]:
    """Return what is known of an ended run: a sentence, its reason, and the commands that show more."""
    took = f" after {minutes(result.duration_s)}" if result.duration_s is not None else ""
    of = f" in {result.world}" if result.world else ""
    lines = [f"run {result.id}{of}, started {started_text(result)}: {word_of(result)}{took}"]
    if tags := _tags(result):
        lines.append(f"  {tags} tags read")
    if result.why:
        lines.append(f"  {result.why}")
    if result.report:
        lines.append(f"  report {result.report}")
    return lines
