"""A console, and the voice tab of a browser that is connected to it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.support.console_browser import Browser

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost


def serve_console(host: GraphHost, folder: Path, **parameters: Any) -> Console:
    """Start a console whose files are in a folder."""
    from lupin_runtime.console.node import Console

    files = {"folder": str(folder), "sessions_file": str(folder / "sessions.json")}
    console: Console = host.add(Console({"port": 0, "rosbridge_port": 0, **files, **parameters}))
    return console


def journal(folder: Path) -> list[dict[str, Any]]:
    """Return the console's command journal."""
    return [json.loads(line) for line in (folder / "console_commands.jsonl").read_text().splitlines()]


class VoiceClient:
    """Sends turns and calls, and waits for the results."""

    def __init__(self, browser: Browser) -> None:
        self.client = browser.socket("/_api/voice")
        self._number = 0

    def send(self, **message: Any) -> None:
        """Send one message."""
        self.client.socket.send(json.dumps(message))

    def turn(self, by: str = "speech", *, ended: bool = True) -> None:
        """Begin a turn of the operator."""
        self._number += 1
        self.send(turn={"id": f"turn {self._number}", "by": by, "ended": ended})

    def begin_call(self, tool: str, /, **arguments: Any) -> str:
        """Call a tool, and return the call's id."""
        self._number += 1
        identifier = f"call {self._number}"
        self.send(call={"id": identifier, "name": tool, "arguments": arguments})
        return identifier

    def response(self, identifier: str) -> dict[str, Any]:
        """Wait for the response to a call."""
        found = self.client.wait(lambda message: message.get("result", {}).get("id") == identifier)
        response: dict[str, Any] = found["result"]["response"]
        return response

    def call(self, tool: str, /, **arguments: Any) -> dict[str, Any]:
        """Call a tool, and return the response."""
        return self.response(self.begin_call(tool, **arguments))

    def confirm(self, tool: str, /, **arguments: Any) -> dict[str, Any]:
        """Call a tool, have it read back, and confirm it in the operator's next turn."""
        first = self.call(tool, **arguments)
        assert first["ok"] is False and first["confirm"], first
        self.turn()
        return self.call(tool, **arguments, confirmation=first["confirmation"])

    def wait_for_state(self, condition: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """Wait for a state of the session, and return it."""
        found: dict[str, Any] = self.client.wait(lambda message: "state" in message and condition(message["state"]))["state"]
        return found

    def close(self) -> None:
        """Close the connection."""
        self.client.close()
