"""The templates, styles and scripts of the pages."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from lupin_runtime.report.findings import clock
from lupin_runtime.report.page.map_svg import anchor
from lupin_runtime.report.page.timeline_rows import EVENT_MARKS
from lupin_runtime.report.palette import HEALTH

_FOLDER = Path(__file__).parent
_SEVERITY_LABELS = {"error": ("✖", "Problem"), "warn": ("▲", "Warning"), "note": ("●", "Note"), "good": ("✔", "Good")}


@cache
def page_environment() -> Environment:
    """Return the environment of the templates, which escape all text."""
    environment = Environment(loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined)
    environment.filters.update(clock=clock, anchor=anchor)
    environment.globals.update(severity_labels=_SEVERITY_LABELS, event_marks=EVENT_MARKS)
    return environment


def styles() -> Markup:
    """Return the style sheet, with the palette's health colors as variables."""
    colors = "".join(f"--health-{name}:{color};" for name, color in HEALTH.items())
    return Markup(f"{_read('page.css')}:root{{{colors}}}")


def script(*names: str) -> Markup:
    """Return the scripts as one, whose names do not become global."""
    return Markup('"use strict";\n(() => {\n' + "\n".join(map(_read, names)) + "})();\n")


def _read(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
