"""The report of a run and the comparison of two, as JSON and HTML: read from recordings, scored where truth is known."""

from lupin_runtime.report.build import ComparisonReport, Report, build_comparison, build_report
from lupin_runtime.report.comparison import comparison_lines

__all__ = ["ComparisonReport", "Report", "build_comparison", "build_report", "comparison_lines"]
