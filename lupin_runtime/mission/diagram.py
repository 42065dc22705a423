"""Draws the mission's state machine from its specification, without external tools."""

from __future__ import annotations

from collections.abc import Callable

from lupin_runtime.mission.diagram_model import Diagram, build_diagram
from lupin_runtime.mission.diagram_svg import draw_svg
from lupin_runtime.mission.diagram_text import draw_ascii, draw_dot, draw_mermaid
from lupin_runtime.mission.hsm_spec import HsmSpec

FORMATS: dict[str, Callable[[Diagram], str]] = {
    "mermaid": draw_mermaid,
    "dot": draw_dot,
    "svg": draw_svg,
    "ascii": draw_ascii,
}


def draw(spec: HsmSpec, form: str) -> str:
    """Return the diagram in one of FORMATS."""
    return FORMATS[form](build_diagram(spec))
