"""What the robot did while the link was interrupted is read from its true path."""

from __future__ import annotations

import pytest

from bench.link_rig import LinkFault, in_outage
from tests.support.true_path import Sample, moved_m

FAULT = LinkFault("switch-dead", from_s=10.0, to_s=13.0)


def path(stops_at_s: float) -> list[Sample]:
    """Return a path at 0.3 m/s, ten places a second, until it stops."""
    return [Sample(tick / 10, 0.03 * min(tick, round(10 * stops_at_s)), 0.0) for tick in range(200)]


def test_path_of_an_outage_ends_where_the_robot_stopped() -> None:
    found = in_outage(path(10.6), FAULT)
    assert found == {"lasted_s": 3.0, "moved_m": pytest.approx(0.18), "moved_after_stop_m": 0.0}


def test_robot_that_drives_on_in_an_outage_is_seen() -> None:
    assert in_outage(path(19.0), FAULT)["moved_after_stop_m"] == pytest.approx(0.6)


def test_length_of_a_path_is_that_of_its_turns() -> None:
    assert moved_m([Sample(0.0, 0.0, 0.0), Sample(0.1, 3.0, 4.0), Sample(0.2, 3.0, 0.0)]) == 9.0
