"""sd_notify against a real datagram socket."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.stack.sd_notify import Notifier


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(str(tmp_path / "notify"))
        channel.settimeout(2.0)
        yield channel


def received(channel: socket.socket) -> list[str]:
    channel.setblocking(False)
    lines = []
    while True:
        try:
            lines.append(channel.recv(4096).decode())
        except BlockingIOError:
            return lines


def test_notifier_sends_ready_status_and_stopping(manager: Any) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    notifier.status("waiting for\n/scan")
    notifier.status("waiting for /scan")
    notifier.ready()
    notifier.stopping()
    assert received(manager) == ["STATUS=waiting for /scan", "READY=1", "STOPPING=1"]


def test_children_do_not_inherit_the_notify_socket(manager: Any) -> None:
    environment = {
        "NOTIFY_SOCKET": manager.getsockname(),
        "WATCHDOG_USEC": "1000000",
        "WATCHDOG_PID": str(os.getpid()),
        "A": "b",
    }
    Notifier(environment)
    assert environment == {"A": "b"}


def test_watchdog_is_fed_twice_within_its_limit(manager: Any) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "30000000"})
    assert notifier.watchdog_period_s == 15.0
    for _ in range(50):
        notifier.alive()
    assert received(manager) == ["WATCHDOG=1"]


@pytest.mark.parametrize("pid", ["1", str(os.getpid() + 1)], ids=["first", "next"])
def test_watchdog_of_another_process_is_not_fed(manager: Any, pid: str) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "30000000", "WATCHDOG_PID": pid})
    notifier.alive()
    assert notifier.watchdog_period_s == 0.0 and received(manager) == []


def test_notifier_reaches_an_abstract_socket() -> None:
    name = f"lupin-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(f"\0{name}")
        Notifier({"NOTIFY_SOCKET": f"@{name}"}).ready()
        assert received(channel) == ["READY=1"]


def test_without_a_manager_nothing_is_sent() -> None:
    notifier = Notifier({})
    notifier.ready()
    notifier.alive()


def test_missing_manager_does_not_stop_the_service(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "gone")}).ready()
    assert "systemd did not receive READY" in capsys.readouterr().out
