"""A mission across a link like WiFi, which fails for 3 s and for 5 s while the robot drives."""

from __future__ import annotations

import pytest

from bench.bench_link import INTERRUPTIONS, measure
from lupin_sim.host.prerequisites import missing_prerequisite

pytestmark = [pytest.mark.host, pytest.mark.mission]


def test_mission_across_wifi_ends_done_and_reports_outages() -> None:
    if missing := missing_prerequisite():
        pytest.skip(missing)
    figures = measure("walled", faults=True)
    assert figures["met"], figures
    assert figures["state"] == "DONE" and figures["share_read"] == 1.0 and figures["collisions"] == 0
    assert len(figures["interruptions"]) == len(INTERRUPTIONS)
    for name, interruption in figures["interruptions"].items():
        assert interruption["moved_after_stop_m"] <= 0.01, name
    for (_, lasts_s), outage in zip(INTERRUPTIONS, figures["reported"]):
        assert outage["to_s"] - outage["from_s"] >= 0.8 * lasts_s, figures["reported"]
