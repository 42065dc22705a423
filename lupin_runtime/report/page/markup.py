"""Writes SVG and JSON into the page. Text is escaped unless it is `Markup`, which Jinja templates honour too."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from markupsafe import Markup, escape


def element(name: str, *children: str, **attributes: Any) -> Markup:
    """Return an element. Children and attributes are escaped, except children that are `Markup`.

    An attribute's trailing underscore is dropped and its other underscores become dashes. None and False omit an attribute,
    True writes its name only.
    """
    parts = [name]
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        label = key.rstrip("_").replace("_", "-")
        parts.append(label if value is True else f'{label}="{escape(_shorten(value))}"')
    return Markup(f"<{' '.join(parts)}>{join(children)}</{name}>")


def join(parts: Iterable[str]) -> Markup:
    """Concatenate parts, escaping those that are not `Markup`."""
    return Markup("").join(parts)


def _shorten(value: Any) -> Any:
    """Write floats with two decimals: a hundredth of a pixel or centimeter is precise enough."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else value


def path_data(points: Iterable[tuple[float, float]]) -> str:
    """Return SVG path data, `M x y L x y …`, of a sequence of (x, y)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def script_json(value: Any) -> Markup:
    """Return JSON for a <script> element; its text cannot close the element (`</script>`, `<!--`)."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))
