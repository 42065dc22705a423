"""Whole missions in a greenhouse without physics: nothing that can be reached is missed, and they end."""

from __future__ import annotations

import pytest

from bench.flat_greenhouse import explore


@pytest.mark.parametrize(("world", "noise"), [("random:13", 0.0), ("walled", 0.0), ("walled", 0.02)])
def test_every_reachable_tag_is_found_and_read_and_the_robot_comes_home(world, noise):
    result, house = explore(world, range_sigma_m=noise, pose_sigma_m=noise)
    assert (result.state, result.missed) == ("DONE", [])
    assert house.pose.distance_to(house.world.start) < 0.3
    assert house.orchestrator.hsm.ignored == []
    assert result.exploration_s < 600.0
