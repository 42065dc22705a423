"""Times that no wall clock can show while this version of Lupin is used."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.plausible_time import EARLIEST_S, LATEST_S, clock_fault
from lupin_cli.systemd.units import clock_sync_script


@pytest.mark.parametrize(
    ("epoch_s", "words"),
    [
        (240.0, ("1970-01-01 00:04 UTC", "this version of Lupin is newer")),
        (EARLIEST_S - 1, ("2024-12-31 23:59 UTC", "newer")),
        (EARLIEST_S, ()),
        (LATEST_S - 1, ()),
        (LATEST_S, ("2045-01-01 00:00 UTC", "decades after")),
        (-5.0, ("-5 s since 1970", "newer")),
        (1e15, ("1000000000000000 s since 1970", "decades after")),
    ],
)
def test_impossible_time_is_named(epoch_s: float, words: tuple[str, ...]) -> None:
    fault = clock_fault(epoch_s)
    assert bool(fault) == bool(words) and all(word in fault for word in words)


def test_this_machine_has_a_plausible_time() -> None:
    assert clock_fault(time.time()) == ""


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_time_is_judged(epoch_s: float) -> None:
    assert bool(clock_fault(epoch_s)) != (EARLIEST_S <= epoch_s < LATEST_S)


def test_boot_script_has_the_same_limits() -> None:
    assert f"-lt {EARLIEST_S} ]" in clock_sync_script() and f"-ge {LATEST_S} ]" in clock_sync_script()
