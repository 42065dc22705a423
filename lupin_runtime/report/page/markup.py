"""Writing HTML and SVG by hand without ever writing text that was not escaped."""

from __future__ import annotations

import html
import json
from typing import Any


def esc(value: Any) -> str:
    """Text for an element or a quoted attribute."""
    return html.escape(str(value), quote=True)


def tag(name: str, *children: str, **attributes: Any) -> str:
    """An element. Children are markup, so text among them has gone through `esc`; attributes are escaped here.

    An attribute's trailing underscore is dropped and others become dashes; None leaves it out, True writes its name only.
    """
    parts = [name]
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        label = key.rstrip("_").replace("_", "-")
        parts.append(label if value is True else f'{label}="{esc(_number(value))}"')
    return f"<{' '.join(parts)}>{''.join(children)}</{name}>"


def void(name: str, **attributes: Any) -> str:
    """An element without content, such as `img`."""
    return tag(name, **attributes).removesuffix(f"</{name}>")


def _number(value: Any) -> Any:
    """Coordinates need no more than two decimals of a pixel or a centimetre."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else value


def path_data(points: Any) -> str:
    """`M x y L x y …` of a sequence of (x, y)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def script_json(value: Any) -> str:
    """JSON for inside a <script> element, which no text in it can end (`</script>`, `<!--`)."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
