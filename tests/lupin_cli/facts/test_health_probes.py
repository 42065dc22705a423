"""The probes of a machine's health, run by a POSIX shell on this machine: their parsers accept the output."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.base import Output
from lupin_cli.facts.account import ACCOUNT
from lupin_cli.facts.base import Fact
from lupin_cli.facts.boot import BOOT
from lupin_cli.facts.chrony import CHRONY
from lupin_cli.facts.clock import CLOCK, Clock, offset
from lupin_cli.facts.devices import DEVICES, SERVICE_OF_GROUP
from lupin_cli.facts.memory import MEMORY
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.sections import parse_sections
from lupin_cli.facts.storage import STORAGE
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.thermal import THERMAL
from lupin_cli.facts.units import UNIT_STATES
from lupin_cli.facts.versions import VERSIONS

FACTS = (ACCOUNT, BOOT, CHRONY, CLOCK, DEVICES, SYSTEM_JOURNAL, MEMORY, STORAGE, THERMAL, UNIT_STATES, VERSIONS)
SHELL = shutil.which("dash") or "/bin/sh"


def run_probe(fact: Fact[Any]) -> Output:
    done = subprocess.run([SHELL, "-c", fact.probe], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    return Output(done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.name)
def test_probe_of_this_machine_parses_without_stderr(fact: Fact[Any]) -> None:
    output = run_probe(fact)
    assert fact.parse(output) is not None
    assert output.stderr == ""


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.name)
def test_truncated_output_parses_or_raises_value_error(fact: Fact[Any]) -> None:
    whole = run_probe(fact).stdout
    for end in range(0, len(whole), max(1, len(whole) // 150)):
        try:
            fact.parse(Output(None, whole[:end]))
        except ValueError as error:
            assert str(error)


def test_ros_process_has_the_name_of_its_parent(tmp_path: Path) -> None:
    library = tmp_path / "librcl.so"
    library.write_bytes(b"x")
    mapping = "import mmap, sys; f = open(sys.argv[1], 'r+b'); m = mmap.mmap(f.fileno(), 1); print(1, flush=True); input()"
    script = f"echo 'a (b) c' >/proc/$$/comm; {shlex.quote(sys.executable)} -c {shlex.quote(mapping)} {library}; :"
    with subprocess.Popen([SHELL, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdin is not None and parent.stdout is not None and parent.stdout.readline() == "1\n"
        found = [each for each in ROS_PROCESSES.parse(run_probe(ROS_PROCESSES)) if str(library) in each.arguments]
        parent.stdin.close()
    assert [(each.parent, each.parent_name) for each in found] == [(parent.pid, "a (b) c")]


@pytest.mark.parametrize(
    ("group", "unit"),
    [
        ("0::/system.slice/mirte-ros.service", "mirte-ros.service"),
        ("0::/system.slice/system-getty.slice/getty@tty1.service/x.scope", "getty@tty1.service"),
        ("0::/user.slice/user-1000.slice/session-2.scope", ""),
        ("0::/user.slice/user-1000.slice/user@1000.service/app.slice/app-cheese-7.scope", ""),
        ("0::/user.slice/user-1000.slice/user@1000.service/app.slice/webcam.service", ""),
        ("4:pids:/user.slice/user-1000.slice/user@1000.service\n1:name=systemd:/user.slice/user-1000.slice/c2.scope", ""),
        ("0::/", ""),
    ],
)
def test_session_of_a_person_is_no_service(tmp_path: Path, group: str, unit: str) -> None:
    file = tmp_path / "cgroup"
    file.write_text(f"{group}\n")
    done = subprocess.run([SHELL, "-c", f"{SERVICE_OF_GROUP} {file}"], capture_output=True, text=True, timeout=60)
    assert (done.stdout.strip(), done.stderr) == (unit, "")


def test_boot_has_uptime_of_this_machine() -> None:
    boot = BOOT.parse(run_probe(BOOT))
    assert boot.uptime_s == pytest.approx(time.clock_gettime(time.CLOCK_BOOTTIME), abs=60)
    assert boot.cores >= 1


def test_offset_of_own_clock_is_within_bound() -> None:
    before = time.time_ns()
    clock = CLOCK.parse(run_probe(CLOCK))
    found = offset(clock, (before, time.time_ns()))
    assert abs(found.offset_s) <= found.bound_s
    assert found.at_least_s == 0.0


def test_true_offset_is_within_bound_for_any_reading_time() -> None:
    ahead_ns = 5_000_000_000
    for delay_ns in (0, 400_000_000, 1_000_000_000):
        read = 10_000_000_000 + delay_ns + ahead_ns
        found = offset(Clock(read, read + 1_000_000, None), (10_000_000_000, 11_001_000_000))
        assert found.offset_s - found.bound_s <= 5.0 <= found.offset_s + found.bound_s


def test_sections_are_split_and_text_before_first_is_ignored() -> None:
    sections = parse_sections(Output(0, "motd\n@@ a\n1\n\n2\n@@ b x y\n"))
    assert sections.lines("a") == ("1", "2")
    assert [(section.name, section.argument) for section in sections.sections] == [("a", ""), ("b", "x y")]
    with pytest.raises(ValueError, match="expected a section 'c'"):
        sections.lines("c")
