"""Compares two runs: their figures, tags and findings, and what differs."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any

from lupin_runtime.report.findings import ERROR, SEVERITIES, WARN, RunFinding, clock
from lupin_runtime.report.report_json import ReportInput, figures, finding_content, run_content
from lupin_runtime.report.tags import READ, TagResult, natural_key

SCHEMA = "lupin-comparison/1"
A, B = "A", "B"

_LOWER, _HIGHER, _NEITHER = -1, 1, 0  # which value is better


@dataclass(frozen=True)
class _Figure:
    """A compared figure: its key in `figures`, its name, and its unit, for which it is multiplied by `scale`."""

    key: str
    label: str
    unit: str = ""
    scale: float = 1.0
    digits: int = 0
    better: int = _NEITHER


_FIGURES = (
    _Figure("mission_s", "Duration", "s"),
    _Figure("distance_m", "Distance driven", "m", digits=1),
    _Figure("known_area_m2", "Area mapped", "m²"),
    _Figure("tags_seen", "Tags found", better=_HIGHER),
    _Figure("tags_read", "Tags read", better=_HIGHER),
    _Figure("tags_unreachable", "Tags not reached", better=_LOWER),
    _Figure("flowers", "Flowers"),
    _Figure("bugs", "Bugs"),
    _Figure("collisions", "Collisions", better=_LOWER),
    _Figure("least_clearance_m", "Least clearance", "cm", 100.0, better=_HIGHER),
    _Figure("score_trajectory_rmse_m", "Path error, RMSE", "cm", 100.0, 1, _LOWER),
    _Figure("largest_localization_error_m", "Largest localization error", "cm", 100.0, 1, _LOWER),
    _Figure("score_tag_error_median_m", "Tag error, median", "cm", 100.0, 1, _LOWER),
    _Figure("map_corrections", "Corrections by the map", better=_LOWER),
    _Figure("real_time_factor", "Real-time factor", "×", digits=2, better=_HIGHER),
    _Figure("memory_mb", "Memory, peak", "MB", better=_LOWER),
    _Figure("ready_s", "Ready after", "s", digits=1, better=_LOWER),
)


@dataclass(frozen=True)
class FigureRow:
    """A figure of both runs in `unit`, None where it is unknown. `better` is A, B, or empty if neither is."""

    key: str
    label: str
    unit: str
    digits: int
    a: float | None
    b: float | None
    better: str

    @property
    def difference(self) -> float | None:
        """How much more B has than A; None if one is unknown."""
        return None if self.a is None or self.b is None else round(self.b - self.a, self.digits)


@dataclass(frozen=True)
class TagSide:
    """A tag in one run: its outcome, when it was read, and its error."""

    outcome: str
    read_s: float | None
    error_m: float | None


@dataclass(frozen=True)
class TagPair:
    """A tag in both runs; None where the run did not find it."""

    tag_id: str
    a: TagSide | None
    b: TagSide | None

    @property
    def differs(self) -> bool:
        """Whether the outcomes differ."""
        return (self.a and self.a.outcome) != (self.b and self.b.outcome)

    @property
    def better(self) -> str:
        """The only run that read the tag, A or B; empty if both did, or neither."""
        read = [name for name, side in ((A, self.a), (B, self.b)) if side is not None and side.outcome == READ]
        return read[0] if len(read) == 1 else ""

    @property
    def later_s(self) -> float | None:
        """How much later B read the tag than A; None if not both did."""
        if self.a is None or self.b is None or self.a.read_s is None or self.b.read_s is None:
            return None
        return self.b.read_s - self.a.read_s


@dataclass(frozen=True)
class SharedFinding:
    """A finding, and which runs have it: A, B, or both. Its text is of the first of them."""

    finding: RunFinding
    runs: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """Two runs, called A and B, and what they have in common or not."""

    a: ReportInput
    b: ReportInput
    figures: tuple[FigureRow, ...]
    tags: tuple[TagPair, ...]
    findings: tuple[SharedFinding, ...]

    @property
    def caveats(self) -> list[str]:
        """Reasons why the figures of the two runs cannot simply be compared."""
        found = []
        for name in ("target", "world", "mission_type"):
            values = [run_content(report).get(name) or "" for report in (self.a, self.b)]
            if values[0] != values[1] and all(values):
                found.append(f"The runs differ in their {name.replace('_', ' ')}: {values[0]} and {values[1]}.")
        found += [f"The report of {name} is incomplete." for name, report in ((A, self.a), (B, self.b)) if report.damage]
        return found


def compare(a: ReportInput, b: ReportInput) -> Comparison:
    """Compare two runs."""
    return Comparison(a, b, _figure_rows(a, b), _tag_pairs(a, b), _shared_findings(a, b))


def comparison_content(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison for scripts, as `docs/report.md` describes it."""
    return {
        "schema": SCHEMA,
        "a": run_content(comparison.a),
        "b": run_content(comparison.b),
        "caveats": comparison.caveats,
        "figures": [
            {"name": row.key, "label": row.label, "unit": row.unit, "a": row.a, "b": row.b}
            | {"difference": row.difference, "better": row.better or None}
            for row in comparison.figures
        ],
        "tags": [
            {"id": pair.tag_id, "differs": pair.differs, "a": pair.a and asdict(pair.a), "b": pair.b and asdict(pair.b)}
            for pair in comparison.tags
        ],
        "findings": [finding_content(row.finding) | {"runs": list(row.runs)} for row in comparison.findings],
    }


def comparison_lines(comparison: Comparison) -> list[str]:
    """Return the comparison as lines for a terminal: the figures that are known, then the tags and findings that differ."""
    rows = [("", f"{A} {comparison.a.run_id}", f"{B} {comparison.b.run_id}", "difference")]
    rows += [("Outcome", comparison.a.state, comparison.b.state, "")]
    for row in comparison.figures:
        a, b, difference = figure_texts(row)
        rows.append((row.label, a, b, f"{difference}, {row.better} is better" if row.better else difference))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in rows]
    for pair in comparison.tags:
        if pair.differs:
            lines.append(f"tag {pair.tag_id}: {tag_text(pair.a)} in {A}, {tag_text(pair.b)} in {B}")
    for shared in comparison.findings:
        if len(shared.runs) == 1 and shared.finding.severity in (ERROR, WARN):
            lines.append(f"only {shared.runs[0]}: {shared.finding.title}")
    return [*comparison.caveats, *lines]


def figure_texts(row: FigureRow) -> tuple[str, str, str]:
    """Return the values of A and B and the signed difference as text."""
    a, b = ("–" if v is None else f"{v:.{row.digits}f} {row.unit}".rstrip() for v in (row.a, row.b))
    if not row.difference:
        return a, b, "same" if row.difference == 0.0 else ""
    return a, b, f"{row.difference:+.{row.digits}f} {row.unit}".rstrip()


def tag_text(side: TagSide | None) -> str:
    """Return a tag's outcome, time and error as text."""
    if side is None:
        return "not found"
    time = f" at {clock(side.read_s)}" if side.read_s is not None else ""
    error = f", {side.error_m * 100:.1f} cm off" if side.error_m is not None else ""
    return f"{side.outcome.replace('_', ' ')}{time}{error}"


def _figure_rows(a: ReportInput, b: ReportInput) -> tuple[FigureRow, ...]:
    of_a, of_b = figures(a), figures(b)
    rows = [_figure_row(figure, of_a[figure.key], of_b[figure.key]) for figure in _FIGURES]
    return tuple(row for row in rows if row.a is not None or row.b is not None)


def _figure_row(figure: _Figure, value_a: float | None, value_b: float | None) -> FigureRow:
    a, b = (None if v is None else round(float(v) * figure.scale, figure.digits) for v in (value_a, value_b))
    better = ""
    if a is not None and b is not None and a != b and figure.better != _NEITHER:
        better = A if (a > b) == (figure.better == _HIGHER) else B
    return FigureRow(figure.key, figure.label, figure.unit, figure.digits, a, b, better)


def _tag_pairs(a: ReportInput, b: ReportInput) -> tuple[TagPair, ...]:
    of_a, of_b = ({tag.tag_id: _tag_side(tag, report) for tag in report.tags} for report in (a, b))
    return tuple(TagPair(tag_id, of_a.get(tag_id), of_b.get(tag_id)) for tag_id in sorted(of_a | of_b, key=natural_key))


def _tag_side(tag: TagResult, report: ReportInput) -> TagSide:
    truth = report.tag_truth.get(tag.tag_id)
    return TagSide(tag.outcome, tag.read_s, truth.error_m if truth is not None else None)


def _shared_findings(a: ReportInput, b: ReportInput) -> tuple[SharedFinding, ...]:
    """Match findings that differ in nothing but numbers, such as how large an error was; but not those of other tags."""
    found: dict[tuple[object, ...], SharedFinding] = {}
    for name, report in ((A, a), (B, b)):
        for finding in report.findings:
            key = (finding.severity, _without_numbers(finding.title), finding.tag_ids)
            known = found.get(key, SharedFinding(finding, ()))
            found[key] = SharedFinding(known.finding, tuple(dict.fromkeys((*known.runs, name))))
    return tuple(sorted(found.values(), key=lambda row: (SEVERITIES.index(row.finding.severity), row.runs)))


def _without_numbers(title: str) -> str:
    """Return a title in which numbers, and the plural that follows them, make no difference."""
    return re.sub(r"s\b", "", re.sub(r"\d+(\.\d+)?", "#", title))
