"""What `lupin up` and `lupin console` print about a console that is listening."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TextIO

from lupin_runtime.console.banner import ConsoleUrls, banner, screen_of
from lupin_runtime.console.description import ConsoleDescription, spoken
from lupin_runtime.stack.dds import discovery_mode


def access_banner(described: ConsoleDescription, environment: Mapping[str, str], stream: TextIO, *, share: bool = False) -> str:
    """Return where the console is and how it finds the robot; on a terminal, also the code that pairs another browser.

    With `share`, it is the code that pairs a viewer. `environment` is that of the console's process.
    """
    network = described.network_urls()
    programs = (f"rosbridge ws://localhost:{described.rosbridge_port}",) if described.rosbridge_port else ()
    urls = ConsoleUrls(network, (f"http://localhost:{described.port}", *programs))
    code = described.codes["viewer" if share else "operator"]
    notes = [f"{spoken(code)} pairs one {'viewer' if share else 'browser'}; show the next code with: lupin console code"]
    screen = screen_of(stream, environment)
    return banner(
        urls,
        discovery_mode(environment),
        screen,
        pairing_url=f"{network[0]}/#code={code}" if network else None,
        notes=notes if screen.interactive else (),
    )
