"""The report of a run, as JSON and as an HTML page: read from its recording, scored where the simulator's truth is known."""

from lupin_runtime.report.build import Report, build_report

__all__ = ["Report", "build_report"]
