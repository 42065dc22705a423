"""The benchmarks' rosbridge_suite: what is missing is named with its command, and no process outlives its rig."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from bench import bench_console, server_rig
from bench.peers import rosbridge_suite
from bench.runner import NOT_MEASURED


@pytest.fixture
def checkout(tmp_path: Path) -> Callable[[str], Path]:
    """Return what makes a checkout whose server is a program."""

    def make(program: str) -> Path:
        script = tmp_path / "suite" / "rosbridge_server" / "scripts" / "rosbridge_websocket.py"
        script.parent.mkdir(parents=True)
        script.write_text(program, encoding="utf-8")
        return tmp_path / "suite"

    return make


def install(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Let the peer's process find empty packages with the names of those that the server imports."""
    for name in ("tornado", "bson", "PIL"):
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").touch()
    monkeypatch.setenv("PYTHONPATH", str(folder))


def test_missing_packages_are_named_with_the_command(checkout: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "tornado" else object())
    problem = rosbridge_suite.missing(checkout(""))
    assert "needs tornado in this environment" in problem
    assert f"{sys.executable} -m pip install --no-deps --require-hashes -r " in problem
    assert Path(problem.rsplit(" ", 1)[1]).is_file()


def test_folder_without_the_server_is_named(tmp_path: Path) -> None:
    assert f"{tmp_path} is no checkout of rosbridge_suite" in rosbridge_suite.missing(tmp_path)


def test_benchmark_refuses_an_incomplete_peer_before_measuring(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_console, "small_messages", lambda *_: pytest.fail("measured"))
    assert bench_console.main(["--suite", str(tmp_path)]) == NOT_MEASURED
    assert "git clone" in capsys.readouterr().err


def test_peer_that_fails_is_reported_with_its_last_words(
    checkout: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install(monkeypatch, tmp_path / "packages")
    suite = checkout("raise RuntimeError('no such message type')")
    with (
        pytest.raises(SystemExit, match=r"does not listen: (.|\n)*no such message type"),
        server_rig.server_rig(rosbridge_suite.server_command(suite)),
    ):
        pass


def test_peer_that_ignores_sigterm_is_ended(
    checkout: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install(monkeypatch, tmp_path / "packages")
    monkeypatch.setattr(server_rig, "END_TIMEOUT_S", 0.2)
    program = """
import http.server, signal, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
http.server.HTTPServer(("127.0.0.1", int(sys.argv[2])), http.server.BaseHTTPRequestHandler).serve_forever()
"""
    with server_rig.server_rig(rosbridge_suite.server_command(checkout(program))) as server:
        assert server.process.is_running()
    assert not psutil.pid_exists(server.process.pid)
