"""The probe of the process tree: which memory maps a user can read."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.cleanup.process_tree import PROBE, parse
from lupin_cli.connection.base import Output
from lupin_cli.facts.sections import parse_sections

NOBODY = 65534


def unreadable_maps(script: str, *, user: int | None = None) -> list[Path]:
    """Run the probe as `user`, or as this one; return the files of its section `unreadable`."""
    identity: dict[str, Any] = {} if user is None else {"user": user, "group": user, "extra_groups": []}
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, timeout=30, check=True, cwd="/", **identity)
    output = Output(done.returncode, done.stdout)
    files = parse_sections(output).lines("unreadable")
    assert parse(output).all_maps_readable == (not files)
    return [Path(file) for file in files]


def test_maps_of_another_user_are_reported_as_unreadable() -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root: setuid")
    own = Path(f"/proc/{os.getpid()}/maps")
    assert own.stat().st_mode & 0o777 == 0o444  # so a test of the mode alone would succeed
    assert own in unreadable_maps(PROBE, user=NOBODY)
    assert own not in unreadable_maps(PROBE)


def test_maps_of_own_and_exited_processes_are_not_reported() -> None:
    own, exited = f"/proc/{os.getpid()}/maps", "/proc/999999999/maps"
    assert unreadable_maps(PROBE.replace("in /proc/[0-9]*/maps", f"in {own} {exited}")) == []
