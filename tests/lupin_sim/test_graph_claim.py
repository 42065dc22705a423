"""One simulator per graph: the second one is refused and told whose process is in its way."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_sim.graph_claim import GraphTaken, claim_graph

GRAPH = {"ROS_DOMAIN_ID": f"own-{os.getpid()}"}  # no other test has it
SERVER = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811"}


def test_second_simulator_of_a_graph_is_refused_by_name() -> None:
    with claim_graph(GRAPH):
        with pytest.raises(GraphTaken, match=f"domain {GRAPH['ROS_DOMAIN_ID']}: process {os.getpid()};"):
            claim_graph(GRAPH)
        claim_graph({**GRAPH, **SERVER}).close()  # another graph
        claim_graph({"ROS_DOMAIN_ID": f"{GRAPH['ROS_DOMAIN_ID']}2"}).close()
    claim_graph(GRAPH).close()


def test_claim_of_a_killed_simulator_is_free() -> None:
    program = "from lupin_sim.graph_claim import claim_graph; claim = claim_graph(); print('held', flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", program], env={**os.environ, **GRAPH}, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
        with pytest.raises(GraphTaken, match=f"process {holder.pid};"):
            claim_graph(GRAPH)
        holder.kill()
    claim_graph(GRAPH).close()


def test_simulator_does_not_start_beside_another(tmp_path: Path) -> None:
    with claim_graph(GRAPH):
        done = subprocess.run(
            [sys.executable, "-m", "lupin_sim", "--no-cameras", "--run-dir", str(tmp_path / "run")],
            env={**os.environ, **GRAPH},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 1 and f"process {os.getpid()}" in done.stderr
    assert not (tmp_path / "run").exists()
