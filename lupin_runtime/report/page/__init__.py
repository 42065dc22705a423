"""The report as one HTML page that fetches nothing: styles, script, pictures and data are inside it."""

from lupin_runtime.report.page.assemble import page

__all__ = ["page"]
