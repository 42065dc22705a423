"""The probes of a machine's health, run by a POSIX shell on this machine: their parsers accept the output."""

from __future__ import annotations

import shutil
import subprocess
import time
from typing import Any

import pytest

from lupin_cli.connection.base import Output
from lupin_cli.facts.account import ACCOUNT
from lupin_cli.facts.base import Fact
from lupin_cli.facts.boot import BOOT
from lupin_cli.facts.chrony import CHRONY
from lupin_cli.facts.clock import CLOCK, Clock, offset
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.memory import MEMORY
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
