"""Serves the page from its sources with hot reload: Vite's server, which forwards the page's requests to a console."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

from lupin_cli.run.process_group import TERMINATE_GRACE_S
from lupin_runtime.interpreter import PYTHON

ROOT = Path(__file__).parents[2]
PAGE_SERVER_PORT = 5173
UP_TIMEOUT_S = 180.0  # the first start installs Node's packages
_STOP_TIMEOUT_S = TERMINATE_GRACE_S + 5.0
_POLL_S = 0.1


class PageServerFailed(RuntimeError):
    """The page cannot be served from its sources; the message says what to do."""


class PageServer:
    """Vite's server for `web/` of this checkout, on localhost."""

    def __init__(self, console_url: str, port: int = PAGE_SERVER_PORT, root: Path = ROOT) -> None:
        """Start it for the console at `console_url`. Raises PageServerFailed."""
        builder = root / "tools" / "build_page.py"
        if not builder.is_file() or not (root / "web").is_dir():
            raise PageServerFailed("--dev needs a checkout of Lupin, with the sources of the page in web/; leave it out")
        if _listens(port):
            raise PageServerFailed(f"port {port} is in use, perhaps by another `lupin console --dev`; stop that one first")
        environment = {**os.environ, "LUPIN_CONSOLE": console_url, "LUPIN_PAGE_PORT": str(port)}
        # npm starts further processes. All of them end with this one, however it ends; Ctrl-C does not reach them first.
        command = [*PYTHON, "-m", "lupin_cli.run.process_group", sys.executable, str(builder), "dev"]
        self._process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, start_new_session=True)
        self.url = f"http://localhost:{port}/page/"
        deadline_s = time.monotonic() + UP_TIMEOUT_S
        while not _listens(port):
            if self._process.poll() is not None:
                self.stop()
                raise PageServerFailed(f"the page's server exited with status {self._process.returncode}; its output says why")
            if time.monotonic() > deadline_s:
                self.stop()
                raise PageServerFailed(f"the page's server did not listen on port {port} within {UP_TIMEOUT_S:g} s")
            time.sleep(_POLL_S)

    def stop(self) -> None:
        """End it with all its processes."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _listens(port: int) -> bool:
    # Vite listens on the first address of localhost, which may be the one of IPv6.
    for family, host in ((socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")):
        with socket.socket(family) as probe:
            probe.settimeout(1.0)
            if probe.connect_ex((host, port)) == 0:
                return True
    return False
