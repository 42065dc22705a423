"""The mission diagram as text: Mermaid, Graphviz and plain text."""

from __future__ import annotations

from lupin_runtime.mission.diagram_model import Arrow, Diagram
from lupin_runtime.mission.hsm_spec import SEPARATOR


def draw_mermaid(diagram: Diagram) -> str:
    """Return a Mermaid state diagram, which GitHub and GitLab render."""
    lines = ["stateDiagram-v2", f"    [*] --> {_identifier(diagram.initial)}"]
    composites = [state.name for state in diagram.states if state.children]
    for state in diagram.states:
        if state.children:
            lines.append(f"    state {state.name} {{")
            lines += [f"        {state.name}_{child} : {child}" for child in state.children]
            lines.append(f"        [*] --> {state.name}_{state.initial}")
            lines += [f"        {_mermaid_arrow(arrow)}" for arrow in diagram.arrows if arrow.is_within(state.name)]
            lines.append("    }")
        elif state.note:
            lines.append(f"    {state.name} : {state.name}<br/>{state.note}")
    outer = [arrow for arrow in diagram.arrows if not any(arrow.is_within(name) for name in composites)]
    lines += [f"    {_mermaid_arrow(arrow)}" for arrow in outer]
    return "\n".join(lines) + "\n"


def _mermaid_arrow(arrow: Arrow) -> str:
    return f"{_identifier(arrow.source)} --> {_identifier(arrow.dest)} : {arrow.text}"


def _identifier(state: str) -> str:
    return state.replace(SEPARATOR, "_")


def draw_dot(diagram: Diagram) -> str:
    """Return a Graphviz digraph with composite states as clusters."""
    lines = [
        "digraph mission {",
        "    compound=true; rankdir=TB;",
        '    node [shape=box, style=rounded, fontname="Helvetica"]; edge [fontname="Helvetica", fontsize=10];',
        "    start [shape=point];",
        f"    start -> {_identifier(diagram.initial)};",
    ]
    entry = {state.name: f"{state.name}_{state.initial}" for state in diagram.states if state.children}
    for state in diagram.states:
        if not state.children:
            lines.append(f'    {state.name} [label="{state.name}", tooltip="{state.note}"];')
            continue
        lines.append(f'    subgraph cluster_{state.name} {{ label="{state.name}"; style=rounded;')
        lines += [f'        {state.name}_{child} [label="{child}"];' for child in state.children]
        lines.append("    }")
    for arrow in diagram.arrows:
        options = [f'label="{arrow.text}"']
        if arrow.source in entry:
            options.append(f"ltail=cluster_{arrow.source}")
        if arrow.dest in entry:
            options.append(f"lhead=cluster_{arrow.dest}")
        if arrow.is_fault:
            options.append("style=dashed")
        source, dest = (entry.get(name, _identifier(name)) for name in (arrow.source, arrow.dest))
        lines.append(f"    {source} -> {dest} [{', '.join(options)}];")
    return "\n".join([*lines, "}"]) + "\n"


def draw_ascii(diagram: Diagram) -> str:
    """Return every state with its outgoing arrows, one per line."""
    lines: list[str] = []
    for state in diagram.states:
        mark = "  (starts here)" if state.name == diagram.initial else ""
        lines.append(f"{state.name}{mark}{'  — ' + state.note if state.note else ''}")
        lines += _outgoing(diagram, state.name, "  ")
        for child in state.children:
            lines.append(f"  · {child}{'  (first)' if child == state.initial else ''}")
            lines += _outgoing(diagram, SEPARATOR.join((state.name, child)), "      ")
    return "\n".join(lines) + "\n"


def _outgoing(diagram: Diagram, state: str, indent: str) -> list[str]:
    return [f"{indent}{arrow.text} -> {arrow.dest}" for arrow in diagram.arrows if arrow.source == state]
