"""The record of a host's daemon, whose PID may be killed."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from lupin_sim.host import state


def test_record_names_this_process(tmp_path: Path) -> None:
    state.write(tmp_path, os.getpid())
    daemon = state.read(tmp_path)
    assert daemon is not None and daemon.pid == os.getpid() and daemon.alive


@pytest.mark.parametrize("pid", [-1, 0, 1, True, "12", None, 2.5])
@pytest.mark.parametrize("started", [None, 7])
def test_damaged_record_names_no_process(tmp_path: Path, pid: object, started: object) -> None:
    (tmp_path / state.DAEMON_FILE).write_text(json.dumps({"pid": pid, "started": started}))
    assert state.read(tmp_path) is None


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"pid": 7}', '{"pid": 7, "started": 1, "more": 2}'])
def test_incomplete_record_names_no_process(tmp_path: Path, content: str) -> None:
    (tmp_path / state.DAEMON_FILE).write_text(content)
    assert state.read(tmp_path) is None
