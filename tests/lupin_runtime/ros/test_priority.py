"""Scheduling priority: requested for every thread, and optional if it is not permitted."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from lupin_runtime.ros.priority import NICE, request_realtime_scheduling

pytestmark = pytest.mark.graph  # the import loads rclpy


def refuse(*_: object) -> None:
    raise PermissionError("not permitted")


def test_refused_priority_changes_nothing_and_names_the_fix(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", refuse)
    result = request_realtime_scheduling()
    assert result.startswith("ordinary") and "LimitRTPRIO=1" in result and f"LimitNICE={NICE}" in result


def test_without_real_time_a_nice_value_is_requested(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", lambda _, __, value: asked.append(value))
    assert request_realtime_scheduling().startswith(f"nice {NICE}")
    assert set(asked) == {NICE}


def test_permitted_priority_is_set_for_every_thread() -> None:
    code = (
        "import os, threading\n"
        "from lupin_runtime.ros.priority import request_realtime_scheduling\n"
        "gate = threading.Event()\n"
        "[threading.Thread(target=gate.wait, daemon=True).start() for _ in range(3)]\n"
        "result = request_realtime_scheduling()\n"
        "print(result.split()[0], len({os.sched_getscheduler(int(t)) for t in os.listdir('/proc/self/task')}))\n"
        "gate.set()\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    kind, policies = run.stdout.split()
    assert kind in ("real-time", "nice", "ordinary") and policies == "1"
