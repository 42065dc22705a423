"""The server of the page's sources, whose program is replaced here by one that only listens."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import dedent

import psutil
import pytest

from lupin_cli.run import page_server
from lupin_cli.run.page_server import PageServer, PageServerFailed
from tests.support.waiting import wait_until

LISTENS = """
    import os, pathlib, subprocess, sys
    pathlib.Path("asked").write_text(" ".join(sys.argv[1:]) + " " + os.environ["LUPIN_CONSOLE"])
    address = ("127.0.0.1", int(os.environ["LUPIN_PAGE_PORT"]))
    subprocess.run([sys.executable, "-c", f"import socket, time; server = socket.create_server({address}); time.sleep(60)"])
"""
HANGS = """
    import os, pathlib, time
    pathlib.Path("pid").write_text(str(os.getpid()))
    time.sleep(60)
"""
# Whoever starts the tests may ignore SIGHUP (nohup) or SIGINT (a shell's background), which children inherit.
STARTER = """
    import pathlib, signal, sys, time
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    from lupin_cli.run.page_server import PageServer
    server = PageServer("http://127.0.0.1:8090", int(sys.argv[1]), pathlib.Path(sys.argv[2]))
    time.sleep(60)
"""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Makes a checkout whose tools/build_page.py is this program."""

    def make(program: str) -> Path:
        (tmp_path / "web").mkdir()
        (tmp_path / "tools").mkdir()
        (tmp_path / "tools" / "build_page.py").write_text(dedent(program))
        return tmp_path

    monkeypatch.chdir(tmp_path)
    return make


@pytest.fixture
def port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def killed_at_the_end(process: subprocess.Popen[bytes]) -> Iterator[None]:
    try:
        yield
    finally:
        process.kill()
        process.wait()


def test_page_server_listens_for_its_console_and_ends_whole(checkout: Callable[[str], Path], port: int) -> None:
    root = checkout(LISTENS)
    server = PageServer("http://127.0.0.1:8090", port, root)
    assert listens(port) and server.url == f"http://localhost:{port}/page/"
    assert (root / "asked").read_text() == "dev http://127.0.0.1:8090"
    server.stop()
    wait_until(lambda: not listens(port), "the end of the program that listens")
    server.stop()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGKILL])
def test_page_server_ends_with_its_starter(checkout: Callable[[str], Path], port: int, number: signal.Signals) -> None:
    root = checkout(LISTENS)
    starter = subprocess.Popen([sys.executable, "-c", dedent(STARTER), str(port), str(root)])
    wait_until(lambda: listens(port), "the program that listens")
    starter.send_signal(number)
    with killed_at_the_end(starter):
        starter.wait(60)
    wait_until(lambda: not listens(port), "the end of the program that listens")


def test_interrupted_start_leaves_no_process(checkout: Callable[[str], Path], port: int) -> None:
    root = checkout(HANGS)
    starter = subprocess.Popen([sys.executable, "-c", dedent(STARTER), str(port), str(root)])
    wait_until(lambda: (root / "pid").exists() and (root / "pid").read_text(), "the start of the program")
    starter.send_signal(signal.SIGINT)
    with killed_at_the_end(starter):
        starter.wait(60)
    pid = int((root / "pid").read_text())
    wait_until(lambda: not psutil.pid_exists(pid), "the end of the program")


def test_failed_start_is_reported(checkout: Callable[[str], Path], port: int) -> None:
    root = checkout("raise SystemExit(7)")
    with pytest.raises(PageServerFailed, match="exited with status 7"):
        PageServer("http://127.0.0.1:8090", port, root)


def test_server_that_never_listens_is_ended(
    checkout: Callable[[str], Path], port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_server, "UP_TIMEOUT_S", 0.3)
    root = checkout("import time; time.sleep(60)")
    with pytest.raises(PageServerFailed, match="did not listen on port"):
        PageServer("http://127.0.0.1:8090", port, root)


def test_port_in_use_is_named(checkout: Callable[[str], Path]) -> None:
    root = checkout("raise SystemExit(7)")
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(PageServerFailed, match="is in use"):
        PageServer("http://127.0.0.1:8090", taken.getsockname()[1], root)


def test_installation_without_sources_is_refused(tmp_path: Path, port: int) -> None:
    with pytest.raises(PageServerFailed, match="needs a checkout"):
        PageServer("http://127.0.0.1:8090", port, tmp_path)
