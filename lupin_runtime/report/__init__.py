"""The report of a run: one pass over its recording, scored where the truth is known, as JSON and as a page."""

from lupin_runtime.report.build import Report, build_report

__all__ = ["Report", "build_report"]
