"""The state file of a run on a full disk."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.state_file import StateFile


def test_full_disk_is_reported_once_until_a_write_succeeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = True

    def write_state(_: Run, __: object) -> None:
        if full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Run, "write_state", write_state)
    reported: list[str] = []
    state_file = StateFile(Run(tmp_path), reported.append)
    for _ in range(3):
        state_file.write({})
    (reason,) = reported
    assert "No space left on device" in reason and str(tmp_path) in reason and state_file.problem == reason
    full = False
    state_file.write({})
    assert state_file.problem == ""
    full = True
    state_file.write({})
    assert reported == [reason, reason]
