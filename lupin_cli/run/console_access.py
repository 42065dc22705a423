"""What `lupin up` and `lupin console` say of a console that listens."""

from __future__ import annotations

from lupin_runtime.console.description import ConsoleDescription, spoken


def access_lines(described: ConsoleDescription, share: bool = False) -> list[str]:
    """Its page, and the code that pairs a browser of another computer; with `share`, also a viewer's."""
    lines = [f"console: {described.url}  (rosbridge: ws://127.0.0.1:{described.rosbridge_port})"]
    urls = described.lan_urls()
    lines.append(
        f"code for one other browser: {spoken(described.codes['operator'])}{', at ' + ' or '.join(urls) if urls else ''}"
    )
    if share:
        lines.append(f"code for one that only looks and stops: {spoken(described.codes['viewer'])}")
    return lines
