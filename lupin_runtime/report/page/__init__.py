"""The HTML pages, a report and a comparison. They fetch nothing: each contains its styles, scripts, images and data."""

from lupin_runtime.report.page.comparison_page import render_comparison
from lupin_runtime.report.page.render import render_page

__all__ = ["render_comparison", "render_page"]
