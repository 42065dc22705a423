"""The templates, styles and scripts of the pages."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from lupin_runtime.report.findings import clock
from lupin_runtime.report.page import symbols
from lupin_runtime.report.page.map_drawing import OUTCOME_LABELS, anchor
from lupin_runtime.report.page.timeline_rows import EVENT_MARKS
from lupin_runtime.report.palette import HEALTH, species_label
from lupin_runtime.twin.health import shown_state

_FOLDER = Path(__file__).parent
_SEVERITY_LABELS = {"error": ("✖", "Problem"), "warn": ("▲", "Warning"), "note": ("●", "Note"), "good": ("✔", "Good")}


@cache
def page_environment() -> Environment:
    """Return the environment of the templates, which escape all text."""
    environment = Environment(loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined)
    environment.filters.update(clock=clock, anchor=anchor, number=_number, species_label=species_label)
    environment.filters.update(path_data=symbols.path_data, polygon_points=symbols.polygon_points)
    environment.globals.update(severity_labels=_SEVERITY_LABELS, event_marks=EVENT_MARKS, outcome_labels=OUTCOME_LABELS)
    environment.globals.update(shown_state=shown_state, bug_path=symbols.bug_path, cross_path=symbols.cross_path)
    environment.globals.update(diamond_path=symbols.diamond_path, plate_path=symbols.plate_path)
    return environment


def _number(value: float) -> str:
    """Write two decimals: a hundredth of a pixel, centimeter or second is precise enough."""
    return f"{value:.2f}".rstrip("0").rstrip(".")


def script_json(value: Any) -> Markup:
    """Return JSON for a <script> element; its text cannot close the element (`</script>`, `<!--`)."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def styles() -> Markup:
    """Return the style sheet, with the palette's health colors as variables."""
    colors = "".join(f"--health-{name}:{color};" for name, color in HEALTH.items())
    return Markup(f"{_read('page.css')}:root{{{colors}}}")


def script(*names: str) -> Markup:
    """Return the scripts as one, whose names do not become global."""
    return Markup('"use strict";\n(() => {\n' + "\n".join(map(_read, names)) + "})();\n")


def _read(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
