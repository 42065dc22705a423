"""Draws the mission's state machine from its specification: as Mermaid, Graphviz, SVG or text. Needs no tool."""

from __future__ import annotations

from collections.abc import Callable

from lupin_runtime.mission.diagram_svg import svg
from lupin_runtime.mission.edges import Edge, edges
from lupin_runtime.mission.hsm import SEPARATOR, HsmSpec

_FAULT_TRIGGER = "fault"


def _identifier(state: str) -> str:
    return state.replace(SEPARATOR, "_")


def mermaid(spec: HsmSpec) -> str:
    """A Mermaid state diagram, as code forges show it."""
    lines = ["stateDiagram-v2", f"    [*] --> {_identifier(spec.initial)}"]
    inner = {state.name: state for state in spec.states if state.children}
    all_edges = edges(spec)
    for state in spec.states:
        if state.note:
            lines.append(f"    {state.name} : {state.name}<br/>{state.note}" if not state.children else "")
        if state.children:
            lines.append(f"    state {state.name} {{")
            lines += [f"        {state.name}_{child} : {child}" for child in state.children]
            lines.append(f"        [*] --> {state.name}_{state.initial}")
            lines += [f"        {_arrow(edge)}" for edge in all_edges if _within(edge, state.name)]
            lines.append("    }")
    lines += [f"    {_arrow(edge)}" for edge in all_edges if not any(_within(edge, name) for name in inner)]
    return "\n".join(line for line in lines if line) + "\n"


def _arrow(edge: Edge) -> str:
    return f"{_identifier(edge.source)} --> {_identifier(edge.dest)} : {edge.text}"


def _within(edge: Edge, composite: str) -> bool:
    prefix = composite + SEPARATOR
    return edge.source.startswith(prefix) and edge.dest.startswith(prefix)


def dot(spec: HsmSpec) -> str:
    """A Graphviz digraph, composites as clusters."""
    lines = [
        "digraph mission {",
        "    compound=true; rankdir=TB;",
        '    node [shape=box, style=rounded, fontname="Helvetica"]; edge [fontname="Helvetica", fontsize=10];',
        "    start [shape=point];",
        f"    start -> {_identifier(spec.initial)};",
    ]
    entry = {state.name: f"{state.name}_{state.initial}" for state in spec.states if state.children}
    for state in spec.states:
        if not state.children:
            lines.append(f'    {state.name} [label="{state.name}", tooltip="{state.note}"];')
            continue
        lines.append(f'    subgraph cluster_{state.name} {{ label="{state.name}"; style=rounded;')
        lines += [f'        {state.name}_{child} [label="{child}"];' for child in state.children]
        lines.append("    }")
    for edge in edges(spec):
        options = [f'label="{edge.text}"']
        if edge.source in entry:
            options.append(f"ltail=cluster_{edge.source}")
        if edge.dest in entry:
            options.append(f"lhead=cluster_{edge.dest}")
        if edge.labels == (_FAULT_TRIGGER,):
            options.append("style=dashed")
        source, dest = (entry.get(name, _identifier(name)) for name in (edge.source, edge.dest))
        lines.append(f"    {source} -> {dest} [{', '.join(options)}];")
    return "\n".join([*lines, "}"]) + "\n"


def ascii_art(spec: HsmSpec) -> str:
    """Every state with the ways out of it, as text."""
    all_edges = edges(spec)
    lines: list[str] = []
    for state in spec.states:
        mark = "  (starts here)" if state.name == spec.initial else ""
        lines.append(f"{state.name}{mark}{'  — ' + state.note if state.note else ''}")
        lines += _ways_out(all_edges, state.name, "  ")
        for child in state.children:
            lines.append(f"  · {child}{'  (first)' if child == state.initial else ''}")
            lines += _ways_out(all_edges, SEPARATOR.join((state.name, child)), "      ")
    return "\n".join(lines) + "\n"


def _ways_out(all_edges: list[Edge], state: str, indent: str) -> list[str]:
    return [f"{indent}{edge.text} -> {edge.dest}" for edge in all_edges if edge.source == state]


FORMATS: dict[str, Callable[[HsmSpec], str]] = {"mermaid": mermaid, "dot": dot, "svg": svg, "ascii": ascii_art}
