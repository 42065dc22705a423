"""The probe of the process tree: which memory maps a user can read."""

from __future__ import annotations

import os
import subprocess
import sys
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
    done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, timeout=60, check=True, cwd="/", **identity)
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


NAMING = """
import ctypes, sys
ctypes.CDLL(None).prctl(15, sys.argv[1].encode(), 0, 0, 0)
print("up", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("name", ["a\nb", "(x) S 1", ") R 2\n", "@@ end"])
def test_process_of_any_name_is_read(name: str) -> None:
    """Every user of a computer may call a process whatever he likes."""
    command = [sys.executable, "-I", "-S", "-c", NAMING, name]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdin is not None and process.stdout.readline() == "up\n"
        done = subprocess.run(["sh", "-c", PROBE], capture_output=True, text=True, timeout=60, check=True)
        tree = parse(Output(done.returncode, done.stdout))
        process.stdin.close()
    assert (tree.processes[process.pid].parent, tree.processes[process.pid].name) == (os.getpid(), name)
    assert os.getpid() in tree.processes
