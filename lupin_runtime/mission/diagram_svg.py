"""The mission's state machine as an SVG picture, laid out by a table of places."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

from lupin_runtime.mission.edges import Edge, edges
from lupin_runtime.mission.hsm import SEPARATOR, HsmSpec

# Where each top-level state stands: x, y, width, height in pixels. A composite's leaves are stacked inside it. PREPARE and
# RETURNING are as wide as the families between them, so that every way in and out of a family is a straight vertical.
_PLACES: dict[str, tuple[float, float, float, float]] = {
    "BOOT": (90, 30, 150, 44),
    "READY": (90, 130, 150, 44),
    "PREPARE": (330, 112, 1040, 80),
    "FAULT": (90, 330, 150, 44),
    "EXPLORING": (330, 330, 190, 44),
    "MONITORING": (740, 270, 180, 190),
    "INSPECTING": (1110, 270, 180, 190),
    "DONE": (90, 590, 150, 44),
    "RETURNING": (330, 590, 1040, 44),
}
_CHILD_HEIGHT, _CHILD_STEP, _CHILD_TOP, _LINE = 32.0, 54.0, 32.0, 15.0
_CHARACTER = 6.2  # width of a letter of a label
_STYLE = (
    "svg{--ink:#1d2b24;--paper:#fff;--faint:#eef4ef;--line:#4b6a58;background:var(--paper);"
    "font:12px Helvetica,Arial,sans-serif}"
    "@media(prefers-color-scheme:dark){svg{--ink:#e6efe9;--paper:#141a17;--faint:#1f2923;--line:#8fb3a0}}"
    "text{fill:var(--ink);text-anchor:middle}.s{font-weight:bold}.n{font-style:italic;font-size:11px}"
    ".l{font-size:11px;paint-order:stroke;stroke:var(--paper);stroke-width:5px}"
    ".b{fill:var(--faint);stroke:var(--line)}.c{fill:var(--paper);stroke:var(--line)}.e{fill:none;stroke:var(--line)}"
    "marker path{fill:var(--line)}"
)


@dataclass(frozen=True)
class _Frame:
    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.x + self.width

    @property
    def bottom(self) -> float:
        return self.y + self.height

    @property
    def middle(self) -> tuple[float, float]:
        return self.x + self.width / 2, self.y + self.height / 2


def svg(spec: HsmSpec) -> str:
    """A picture of the machine, light or dark as the reader's page. FAULT's many ways in are said in words."""
    frames = _frames(spec)
    width = max(frame.right for frame in frames.values()) + 90.0
    height = max(frame.bottom for frame in frames.values()) + 40.0
    all_edges = edges(spec)
    faults = [edge for edge in all_edges if edge.labels == ("fault",)]
    drawn = [edge for edge in all_edges if edge not in faults]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}"'
        f' height="{height:.0f}" role="img" aria-label="The state machine of the mission">',
        f"<style>{_STYLE}</style>",
        '<defs><marker id="a" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7"'
        ' orient="auto"><path d="M0 0 10 5 0 10z"/></marker></defs>',
        *(_box(name, frame, any(s.name == name and s.children for s in spec.states)) for name, frame in frames.items()),
    ]
    lines, labels = [], []
    for edge in drawn:
        line, label = _route(edge, frames, drawn)
        lines.append(line)
        labels.append(label)
    if faults:
        x, y = frames["FAULT"].middle
        names = ", ".join(edge.source for edge in faults)
        spared = [s.name for s in spec.states if s.name not in names and s.name != "FAULT"]
        words = "from every state" + (f" but {', '.join(spared)}" if spared else "")
        labels.append(f'<text class="n" x="{x:.0f}" y="{y + 40:.0f}">fault: {escape(words)}</text>')
    return "\n".join([*parts, *lines, *labels, "</svg>"]) + "\n"


def _frames(spec: HsmSpec) -> dict[str, _Frame]:
    frames: dict[str, _Frame] = {}
    below = max(y + height for _, y, _, height in _PLACES.values()) + 60.0
    for index, state in enumerate(spec.states):
        # A state that the table does not know stands below the others: crooked, but there.
        x, y, width, height = _PLACES.get(state.name, (60.0 + 200.0 * index, below, 150.0, 44.0))
        frames[state.name] = _Frame(x, y, width, height)
        for k, child in enumerate(state.children):
            inset = (width - 130.0) / 2
            at = y + _CHILD_TOP + k * _CHILD_STEP
            frames[SEPARATOR.join((state.name, child))] = _Frame(x + inset, at, 130.0, _CHILD_HEIGHT)
    return frames


def _box(name: str, frame: _Frame, composite: bool) -> str:
    y = frame.y + 20.0 if composite else frame.middle[1] + 4.0
    kind = "c" if SEPARATOR in name else "b"
    return (
        f'<rect class="{kind}" x="{frame.x:.0f}" y="{frame.y:.0f}" width="{frame.width:.0f}" height="{frame.height:.0f}"'
        f' rx="8"/><text class="s" x="{frame.middle[0]:.0f}" y="{y:.0f}">{escape(name.split(SEPARATOR)[-1])}</text>'
    )


def _route(edge: Edge, frames: dict[str, _Frame], drawn: list[Edge]) -> tuple[str, str]:
    """The path of an arrow and its label."""
    source, dest = frames[edge.source], frames[edge.dest]
    if _in_the_way(source, dest, frames):
        return _bow(edge, source, dest)
    left, right = max(source.x, dest.x), min(source.right, dest.right)
    if left < right:
        lanes = _lanes(edge, drawn)
        f = (lanes.index(edge) + 1) / (len(lanes) + 1)
        x = left + f * (right - left) if source.width < 900.0 or dest.width < 900.0 else right - 30.0
        down = source.y < dest.y
        y0, y1 = (source.bottom, dest.y) if down else (source.y, dest.bottom)
        # The visible part of the gap: a way out of a leaf starts inside its composite.
        top = max(y for y in (min(y0, y1), _outer_bottom(edge, frames)) if y <= max(y0, y1))
        return _path(x, y0, x, y1), _label(edge, x, top + f * (max(y0, y1) - top))
    y = max(source.y, dest.y) / 2 + min(source.bottom, dest.bottom) / 2
    x0, x1 = (source.right, dest.x) if source.x < dest.x else (source.x, dest.right)
    return _path(x0, y, x1, y), _label(edge, (x0 + x1) / 2, y)


def _top_level(state: str) -> str:
    return state.split(SEPARATOR)[0]


def _lanes(edge: Edge, drawn: list[Edge]) -> list[Edge]:
    """The arrows that run between the same two columns, in the order of their lanes."""
    if _top_level(edge.source) == _top_level(edge.dest):
        return [e for e in drawn if (e.source, e.dest) == (edge.source, edge.dest)]
    pair = {_top_level(edge.source), _top_level(edge.dest)}
    return [e for e in drawn if {_top_level(e.source), _top_level(e.dest)} == pair]


def _outer_bottom(edge: Edge, frames: dict[str, _Frame]) -> float:
    upper = min((edge.source, edge.dest), key=lambda name: frames[name].y)
    return frames[_top_level(upper)].bottom if _top_level(edge.source) != _top_level(edge.dest) else 0.0


def _in_the_way(source: _Frame, dest: _Frame, frames: dict[str, _Frame]) -> bool:
    """Whether an upright arrow would run through another box, or lie on the arrow that comes the other way."""
    if not (source.x == dest.x and source.width == dest.width):
        return False
    low, high = min(source.bottom, dest.bottom), max(source.y, dest.y)
    between = [f for f in frames.values() if f.x == source.x and low <= f.y and f.bottom <= high]
    return bool(between)


def _bow(edge: Edge, source: _Frame, dest: _Frame) -> tuple[str, str]:
    """An arrow round the boxes in between: up on the left, down on the right."""
    side = -1.0 if dest.y < source.y else 1.0
    x = source.x if side < 0 else source.right
    y0, y1 = source.middle[1], dest.middle[1]
    bend = x + side * 44.0
    path = (
        f'<path class="e" marker-end="url(#a)" d="M{x:.0f} {y0:.0f}C{bend:.0f} {y0:.0f} {bend:.0f} {y1:.0f} {x:.0f} {y1:.0f}"/>'
    )
    reach = 38.0 + max(len(label) for label in edge.labels) * _CHARACTER / 2
    if abs(y1 - y0) > 200.0:  # a long one passes other boxes: its label stands on it, nearer to its start
        return path, _label(edge, x + side * 33.0, y0 + 0.3 * (y1 - y0))
    return path, _label(edge, x + side * reach, (y0 + y1) / 2)


def _path(x0: float, y0: float, x1: float, y1: float) -> str:
    return f'<path class="e" marker-end="url(#a)" d="M{x0:.0f} {y0:.0f}L{x1:.0f} {y1:.0f}"/>'


def _label(edge: Edge, x: float, y: float) -> str:
    top = y - (len(edge.labels) - 1) * _LINE / 2 + 4.0
    return "".join(
        f'<text class="l" x="{x:.0f}" y="{top + k * _LINE:.0f}">{escape(label)}</text>' for k, label in enumerate(edge.labels)
    )
