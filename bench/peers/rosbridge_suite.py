"""Runs the server of rosbridge_suite from a checkout, so that a benchmark can measure it.

    python -m bench.peers.rosbridge_suite FOLDER

FOLDER is a checkout of rosbridge_suite (BSD). What it needs is not among Lupin's own packages; `missing` names it, with the
command that installs it. The server also publishes its connected clients, with message types (rosbridge_msgs) of which there is
no wheel; the class that does this is replaced by an empty one, as the benchmarks do not use these topics. Prints the port once
the server listens.
"""

from __future__ import annotations

import importlib.util
import runpy
import shlex
import socket
import sys
import threading
import time
import types
from pathlib import Path
from typing import TextIO

LISTEN_TIMEOUT_S = 30.0
_SCRIPT = Path("rosbridge_server", "scripts", "rosbridge_websocket.py")
_LOCK = Path(__file__).with_suffix(".lock")
_MODULES = {"tornado": "tornado", "bson": "pymongo", "PIL": "pillow"}  # what the server imports, and the package that has it


def missing(folder: Path) -> str:
    """Return what keeps the server of a checkout from running here, with the next command; empty if nothing does."""
    if not (folder / _SCRIPT).is_file():
        return (
            f"{folder} is no checkout of rosbridge_suite: it has no {_SCRIPT}; "
            "get one with: git clone https://github.com/RobotWebTools/rosbridge_suite"
        )
    packages = [package for module, package in _MODULES.items() if importlib.util.find_spec(module) is None]
    if not packages:
        return ""
    command = [sys.executable, "-m", "pip", "install", "--no-deps", "--require-hashes", "-r", str(_LOCK)]
    return f"rosbridge_suite needs {', '.join(packages)} in this environment; install them with: {shlex.join(command)}"


def server_command(folder: Path) -> list[str]:
    """Return the command that runs the server of a checkout."""
    return [sys.executable, "-m", "bench.peers.rosbridge_suite", str(folder)]


class _ClientManager:
    """Replaces the class that publishes the number of clients; does nothing."""

    def __init__(self, *_: object) -> None: ...

    def add_client(self, *_: object) -> None: ...

    def remove_client(self, *_: object) -> None: ...


def _print_port_once_listening(port: int, output: TextIO) -> None:
    deadline_s = time.monotonic() + LISTEN_TIMEOUT_S
    while time.monotonic() < deadline_s:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
        except OSError:
            time.sleep(0.05)
        else:
            print(port, file=output, flush=True)
            return


def main() -> None:
    """Run the server until it is killed: once its ROS context is shut down, SIGTERM does not end it."""
    folder = Path(sys.argv[1])
    if problem := missing(folder):
        raise SystemExit(problem)
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
    script = folder / _SCRIPT
    sys.argv = [str(script), "--port", str(port), "--address", "127.0.0.1"]
    runpy.run_path(str(script), run_name="__main__")


if __name__ == "__main__":
    main()
