"""What a page says about a run as a whole: how it ended, and its place, time and mission."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.report.report_json import ReportInput


@dataclass(frozen=True)
class Outcome:
    """A run's end: CSS class, mark and label."""

    css: str
    mark: str
    label: str


_OUTCOMES = {
    "DONE": Outcome("done", "✔", "Mission done"),
    "FAULT": Outcome("fault", "✖", "Mission failed"),
    "LOST": Outcome("fault", "✖", "Stack lost"),
    "NEVER_UP": Outcome("fault", "✖", "Stack never came up"),
    "REFUSED": Outcome("fault", "✖", "Mission refused"),
    "INTERRUPTED": Outcome("open", "◼", "Interrupted"),
}


def outcome_of(report: ReportInput) -> Outcome:
    """Return how the run ended."""
    return _OUTCOMES.get(report.state, Outcome("open", "◼", f"Ended in {report.state}"))


def run_facts(report: ReportInput) -> list[tuple[str, object]]:
    """Return what is known of the run's place, time and mission."""
    started = str(report.metadata.get("started_at", "")).replace("T", " ").replace("+00:00", " UTC")
    facts = (
        ("Run", report.run_id),
        ("World", report.fact("world")),
        ("Target", report.fact("target")),
        ("Mission", report.log.mission_id),
        ("Started", started),
    )
    return [(name, value) for name, value in facts if value]
