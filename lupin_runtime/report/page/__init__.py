"""The report as one HTML page that fetches nothing: it contains its styles, script, images and data."""

from lupin_runtime.report.page.render import render_page

__all__ = ["render_page"]
