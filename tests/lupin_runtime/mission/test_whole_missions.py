"""Complete missions in the mission simulator: they end, and read every reachable tag."""

from __future__ import annotations

import pytest

from tests.support.mission_simulator import simulate_exploration


@pytest.mark.parametrize(("world", "noise"), [("random:13", 0.0), ("walled", 0.0), ("walled", 0.02)])
def test_simulated_mission_reads_every_reachable_tag(world: str, noise: float) -> None:
    result, simulator = simulate_exploration(world, range_sigma_m=noise, pose_sigma_m=noise)
    assert (result.state, result.missed) == ("DONE", [])
    assert simulator.pose.distance_to(simulator.world.start) < 0.3
    assert simulator.orchestrator.hsm.ignored == []
    assert result.exploration_s < 600.0
