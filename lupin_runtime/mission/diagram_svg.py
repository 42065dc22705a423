"""The mission diagram as SVG. A table places the states; arrows are routed between them."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

from lupin_runtime.mission.diagram_model import Arrow, Diagram
from lupin_runtime.mission.hsm_spec import SEPARATOR

# Position of each top-level state: x, y, width, height in pixels. A composite's leaves are stacked inside it. PREPARE and
# RETURNING span the states between them, so that every arrow between those rows is vertical.
_POSITIONS: dict[str, tuple[float, float, float, float]] = {
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
_CHARACTER = 6.2  # width of a label's character
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
class _Box:
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


def draw_svg(diagram: Diagram) -> str:
    """Return an SVG picture, light or dark like the page around it. The many arrows to FAULT become one line of text."""
    boxes = _place_boxes(diagram)
    width = max(box.right for box in boxes.values()) + 90.0
    height = max(box.bottom for box in boxes.values()) + 40.0
    faults = [arrow for arrow in diagram.arrows if arrow.is_fault]
    drawn = [arrow for arrow in diagram.arrows if not arrow.is_fault]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}"'
        f' height="{height:.0f}" role="img" aria-label="The state machine of the mission">',
        f"<style>{_STYLE}</style>",
        '<defs><marker id="a" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7"'
        ' orient="auto"><path d="M0 0 10 5 0 10z"/></marker></defs>',
        *(_draw_box(name, box, any(s.name == name and s.children for s in diagram.states)) for name, box in boxes.items()),
    ]
    lines, labels = [], []
    for arrow in drawn:
        line, label = _draw_arrow(arrow, boxes, drawn)
        lines.append(line)
        labels.append(label)
    if faults:
        x, y = boxes["FAULT"].middle
        names = ", ".join(arrow.source for arrow in faults)
        others = [s.name for s in diagram.states if s.name not in names and s.name != "FAULT"]
        text = "from every state" + (f" but {', '.join(others)}" if others else "")
        labels.append(f'<text class="n" x="{x:.0f}" y="{y + 40:.0f}">fault: {escape(text)}</text>')
    return "\n".join([*parts, *lines, *labels, "</svg>"]) + "\n"


def _place_boxes(diagram: Diagram) -> dict[str, _Box]:
    boxes: dict[str, _Box] = {}
    below = max(y + height for _, y, _, height in _POSITIONS.values()) + 60.0
    for index, state in enumerate(diagram.states):
        # A state that the table lacks is drawn below the others.
        x, y, width, height = _POSITIONS.get(state.name, (60.0 + 200.0 * index, below, 150.0, 44.0))
        boxes[state.name] = _Box(x, y, width, height)
        for k, child in enumerate(state.children):
            inset = (width - 130.0) / 2
            at = y + _CHILD_TOP + k * _CHILD_STEP
            boxes[SEPARATOR.join((state.name, child))] = _Box(x + inset, at, 130.0, _CHILD_HEIGHT)
    return boxes


def _draw_box(name: str, box: _Box, composite: bool) -> str:
    y = box.y + 20.0 if composite else box.middle[1] + 4.0
    kind = "c" if SEPARATOR in name else "b"
    return (
        f'<rect class="{kind}" x="{box.x:.0f}" y="{box.y:.0f}" width="{box.width:.0f}" height="{box.height:.0f}"'
        f' rx="8"/><text class="s" x="{box.middle[0]:.0f}" y="{y:.0f}">{escape(name.split(SEPARATOR)[-1])}</text>'
    )


def _draw_arrow(arrow: Arrow, boxes: dict[str, _Box], drawn: list[Arrow]) -> tuple[str, str]:
    """Return an arrow's path and its label."""
    source, dest = boxes[arrow.source], boxes[arrow.dest]
    if _is_obstructed(source, dest, boxes):
        return _draw_curve(arrow, source, dest)
    left, right = max(source.x, dest.x), min(source.right, dest.right)
    if left < right:
        lanes = _lanes(arrow, drawn)
        f = (lanes.index(arrow) + 1) / (len(lanes) + 1)
        x = left + f * (right - left) if source.width < 900.0 or dest.width < 900.0 else right - 30.0
        down = source.y < dest.y
        y0, y1 = (source.bottom, dest.y) if down else (source.y, dest.bottom)
        # The visible part of the arrow: from a leaf it starts inside the composite's box.
        top = max(y for y in (min(y0, y1), _outer_bottom(arrow, boxes)) if y <= max(y0, y1))
        return _path(x, y0, x, y1), _label(arrow, x, top + f * (max(y0, y1) - top))
    y = max(source.y, dest.y) / 2 + min(source.bottom, dest.bottom) / 2
    x0, x1 = (source.right, dest.x) if source.x < dest.x else (source.x, dest.right)
    return _path(x0, y, x1, y), _label(arrow, (x0 + x1) / 2, y)


def _top_level(state: str) -> str:
    return state.split(SEPARATOR)[0]


def _lanes(arrow: Arrow, drawn: list[Arrow]) -> list[Arrow]:
    """Return the arrows between the same two states, in the order of their lanes from left to right."""
    if _top_level(arrow.source) == _top_level(arrow.dest):
        return [a for a in drawn if (a.source, a.dest) == (arrow.source, arrow.dest)]
    pair = {_top_level(arrow.source), _top_level(arrow.dest)}
    return [a for a in drawn if {_top_level(a.source), _top_level(a.dest)} == pair]


def _outer_bottom(arrow: Arrow, boxes: dict[str, _Box]) -> float:
    upper = min((arrow.source, arrow.dest), key=lambda name: boxes[name].y)
    return boxes[_top_level(upper)].bottom if _top_level(arrow.source) != _top_level(arrow.dest) else 0.0


def _is_obstructed(source: _Box, dest: _Box, boxes: dict[str, _Box]) -> bool:
    """Return whether a vertical arrow would cross another box."""
    if not (source.x == dest.x and source.width == dest.width):
        return False
    low, high = min(source.bottom, dest.bottom), max(source.y, dest.y)
    between = [box for box in boxes.values() if box.x == source.x and low <= box.y and box.bottom <= high]
    return bool(between)


def _draw_curve(arrow: Arrow, source: _Box, dest: _Box) -> tuple[str, str]:
    """Draw an arrow around the boxes in between: upwards on the left, downwards on the right."""
    side = -1.0 if dest.y < source.y else 1.0
    x = source.x if side < 0 else source.right
    y0, y1 = source.middle[1], dest.middle[1]
    bend = x + side * 44.0
    path = (
        f'<path class="e" marker-end="url(#a)" d="M{x:.0f} {y0:.0f}C{bend:.0f} {y0:.0f} {bend:.0f} {y1:.0f} {x:.0f} {y1:.0f}"/>'
    )
    reach = 38.0 + max(len(label) for label in arrow.labels) * _CHARACTER / 2
    if abs(y1 - y0) > 200.0:  # a long arrow passes other boxes: its label is on it, nearer to its start
        return path, _label(arrow, x + side * 33.0, y0 + 0.3 * (y1 - y0))
    return path, _label(arrow, x + side * reach, (y0 + y1) / 2)


def _path(x0: float, y0: float, x1: float, y1: float) -> str:
    return f'<path class="e" marker-end="url(#a)" d="M{x0:.0f} {y0:.0f}L{x1:.0f} {y1:.0f}"/>'


def _label(arrow: Arrow, x: float, y: float) -> str:
    top = y - (len(arrow.labels) - 1) * _LINE / 2 + 4.0
    return "".join(
        f'<text class="l" x="{x:.0f}" y="{top + k * _LINE:.0f}">{escape(label)}</text>' for k, label in enumerate(arrow.labels)
    )
