"""The probes of a robot's health, run by a POSIX shell on this very machine: what they print is what their parsers read."""

from __future__ import annotations

import shutil
import subprocess
import time

import pytest

from lupin_cli.facts.account import ACCOUNT
from lupin_cli.facts.base import Fact
from lupin_cli.facts.boot import BOOT
from lupin_cli.facts.chrony import CHRONY
from lupin_cli.facts.clock import CLOCK, Clock, offset
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.journal import JOURNAL
from lupin_cli.facts.memory import MEMORY
from lupin_cli.facts.sections import answers
from lupin_cli.facts.storage import STORAGE
from lupin_cli.facts.thermal import THERMAL
from lupin_cli.facts.units import UNIT_STATES
from lupin_cli.facts.versions import VERSIONS
from lupin_cli.target.base import Output

FACTS = (ACCOUNT, BOOT, CHRONY, CLOCK, DEVICES, JOURNAL, MEMORY, STORAGE, THERMAL, UNIT_STATES, VERSIONS)
SHELL = shutil.which("dash") or "/bin/sh"


def ask(fact: Fact) -> Output:
    answer = subprocess.run([SHELL, "-c", fact.probe], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    return Output(answer.returncode, answer.stdout, answer.stderr)


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.name)
def test_a_probe_of_this_machine_is_read_by_its_parser_and_complains_of_nothing(fact: Fact) -> None:
    output = ask(fact)
    assert fact.parse(output) is not None
    assert output.stderr == ""


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.name)
def test_an_answer_cut_anywhere_is_a_value_or_a_value_error(fact: Fact) -> None:
    whole = ask(fact).stdout
    for end in range(0, len(whole), max(1, len(whole) // 150)):
        try:
            fact.parse(Output(None, whole[:end]))
        except ValueError as error:
            assert str(error)


def test_the_boot_is_this_one() -> None:
    boot = BOOT.parse(ask(BOOT))
    assert boot.uptime_s == pytest.approx(time.clock_gettime(time.CLOCK_BOOTTIME), abs=60)
    assert boot.cores >= 1


def test_the_clock_of_this_machine_has_no_offset_beyond_its_bound() -> None:
    before = time.time_ns()
    clock = CLOCK.parse(ask(CLOCK))
    found = offset(clock, (before, time.time_ns()))
    assert abs(found.offset_s) <= found.bound_s
    assert found.at_least_s == 0.0


def test_an_offset_holds_the_truth_within_its_bound_wherever_the_clock_was_read() -> None:
    ahead_ns = 5_000_000_000
    for delay_ns in (0, 400_000_000, 1_000_000_000):
        read = 10_000_000_000 + delay_ns + ahead_ns
        found = offset(Clock(read, read + 1_000_000, None), (10_000_000_000, 11_001_000_000))
        assert found.offset_s - found.bound_s <= 5.0 <= found.offset_s + found.bound_s


def test_sections_are_told_apart_and_nothing_before_the_first_counts() -> None:
    said = answers(Output(0, "motd\n@@ a\n1\n\n2\n@@ b x y\n"))
    assert said.lines("a") == ("1", "2")
    assert [(section.name, section.argument) for section in said.sections] == [("a", ""), ("b", "x y")]
    with pytest.raises(ValueError, match="expected a section 'c'"):
        said.lines("c")
