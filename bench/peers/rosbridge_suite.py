"""Runs the server of rosbridge_suite from a checkout, so that a benchmark can measure it.

    python -m bench.peers.rosbridge_suite FOLDER

FOLDER is a checkout of rosbridge_suite (BSD). For this benchmark, install what it needs into the environment:
`pip install --no-deps --require-hashes -r bench/peers/rosbridge_suite.lock`. The server also publishes its connected clients,
with message types (rosbridge_msgs) of which there is no wheel; the class that does this is replaced by an empty one, as the
benchmarks do not use these topics. Prints the port once the server listens.
"""

from __future__ import annotations

import runpy
import socket
import sys
import threading
import time
import types
from pathlib import Path
from typing import TextIO

_LISTEN_TIMEOUT_S = 30.0


class _ClientManager:
    """Replaces the class that publishes the number of clients; does nothing."""

    def __init__(self, *_: object) -> None: ...

    def add_client(self, *_: object) -> None: ...

    def remove_client(self, *_: object) -> None: ...


def _print_port_once_listening(port: int, output: TextIO) -> None:
    deadline_s = time.monotonic() + _LISTEN_TIMEOUT_S
    while time.monotonic() < deadline_s:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
        except OSError:
            time.sleep(0.05)
        else:
            print(port, file=output, flush=True)
            return


def main() -> None:
    """Run the server until SIGTERM."""
    folder = Path(sys.argv[1])
    for package in ("rosbridge_library", "rosbridge_server"):
        sys.path.insert(0, str(folder / package / "src"))  # noqa: TID251 -- the server's own program imports from here
    clients = types.ModuleType("rosbridge_server.client_manager")
    vars(clients)["ClientManager"] = _ClientManager
    sys.modules[clients.__name__] = clients
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    threading.Thread(target=_print_port_once_listening, args=(port, sys.stdout), daemon=True).start()
    sys.stdout = sys.stderr  # the server prints to standard output, which is for the port only
    script = folder / "rosbridge_server" / "scripts" / "rosbridge_websocket.py"
    sys.argv = [str(script), "--port", str(port), "--address", "127.0.0.1"]
    runpy.run_path(str(script), run_name="__main__")


if __name__ == "__main__":
    main()
