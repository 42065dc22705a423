"""The graph of a booted robot, visited from the laptop across its cable, healthy and with faults."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from lupin_cli.checks import controllers, drive, motor_board, topic_delivery
from lupin_cli.checks.base import Snapshot
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import Diagnosis, diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_sim.host.fixtures import boot_or_skip
from lupin_sim.host.host import PROJECT
from tests.support.findings import assert_findings_match_rows
from tests.support.laptop import Laptop, killed_after
from tests.support.waiting import wait_until

pytestmark = pytest.mark.host

CHECKS = (*controllers.CHECKS, *drive.CHECKS, *topic_delivery.CHECKS, *motor_board.CHECKS)


class GraphLaptop(Laptop):
    """A configured laptop that visits the robot's graph and runs participants of it."""

    def visit(self) -> tuple[Graph, Diagnosis]:
        """Return the robot's graph, and what the checks find in it."""
        env = {"PATH": "/usr/bin:/bin", "HOME": str(self.home)}
        command = [sys.executable, "-m", "lupin_runtime.stack.graph_probe"]
        done = self.host.run(command, env=env, cwd=str(PROJECT), timeout_s=60.0)
        graphs = GRAPH.parse(Output(done.returncode, done.stdout, done.stderr))
        (graph,) = graphs.graphs
        assert (graph.name, graph.kind, graph.error) == ("robot", "robot", "")
        diagnosis = diagnose(CHECKS, Snapshot(Facts("laptop", {"graph": graphs}), None))
        assert_findings_match_rows(diagnosis)
        return graph, diagnosis

    @contextmanager
    def participant(self, *role: str) -> Iterator[None]:
        """Run a participant of the graph on the laptop until the block ends; see tests/support/graph_participant.py."""
        process: subprocess.Popen[str] = self.host.popen(
            [sys.executable, "-m", "tests.support.graph_participant", *role],
            self.sourced_env,
            cwd=str(PROJECT),
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            with killed_after(process):
                assert process.stdout is not None and process.stdout.readline() == "up\n", role
                yield
        finally:
            process.terminate()
            process.communicate(timeout=60)

    def execute(self, *words: str) -> None:
        """Let a participant execute one command, and wait until it exits."""
        with self.participant(*words):
            pass

    def wait_for_findings(self, *expected: str) -> Graph:
        """Visit the graph until exactly these are the root causes. A robot whose stack is starting needs time."""
        seen = ""

        def find() -> Graph | None:
            nonlocal seen
            graph, diagnosis = self.visit()
            ids = sorted(root.finding.id for root in diagnosis.roots)
            seen = f"found {ids}, expected {list(expected)}; {graph.samples} {graph.calls}"
            return graph if ids == sorted(expected) and graph.calls else None

        return wait_until(find, lambda: seen, timeout_s=90.0)


@pytest.fixture(scope="module")
def laptop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GraphLaptop]:
    with boot_or_skip(vendor_robot=True) as host:
        laptop = GraphLaptop(host, tmp_path_factory.mktemp("graph") / "home")
        laptop.configure()
        laptop.wait_for_findings()
        yield laptop


def test_healthy_robot_graph_has_no_findings(laptop: GraphLaptop) -> None:
    graph = laptop.wait_for_findings()
    assert [controller.state for controller in graph.controllers or ()] == ["active"] * 5
    assert all(call.round_trip_s is not None for call in graph.calls) and len(graph.calls) == 2
    assert all(count for _, count in graph.samples) and len(graph.samples) >= 6


def test_multihomed_robot_shows_one_way_data(laptop: GraphLaptop) -> None:
    with laptop.host.robot.with_fault("dual-homed"):
        graph = laptop.wait_for_findings("one-way-data")
        assert any(count for _, count in graph.samples)
        assert [call.round_trip_s for call in graph.calls] == [None, None]
        # The whole doctor also captures packets: its own requests left the laptop, and none arrived.
        _, report = laptop.run_doctor(checks=("dds.multi-homed", "graph.*"))
        (root,) = report["findings"]
        assert root["id"] == "robot-multi-homed"
        assert "one-way-data" in [each["id"] for each in root["consequences"]]
        sent, arrived = (
            next(line for line in root["evidence"] if line.startswith(start))
            for start in (
                "captured on the laptop for 6 s: data sent to the robot: ",
                "captured on the robot: data that arrived from the laptop: ",
            )
        )
        assert " to 10.42.0.1:74" in sent
        assert arrived.endswith(": none")
    laptop.wait_for_findings()


def test_simultaneous_graph_faults_are_each_named(laptop: GraphLaptop) -> None:
    laptop.execute("battery", "0.1")
    with laptop.participant("reader"), laptop.participant("sink"), laptop.participant("page"):
        laptop.wait_for_findings("battery-low", "drive-sink-unheard", "page-holds-bus", "qos-mismatch")
    laptop.execute("battery", "0.85")
    laptop.wait_for_findings()


def test_gamepad_zeros_and_type_mismatch_are_named(laptop: GraphLaptop) -> None:
    with laptop.participant("gamepad"), laptop.participant("mistyped"):
        laptop.wait_for_findings("pad-holds-bus", "type-mismatch")
    laptop.wait_for_findings()


def test_silent_sensor_and_silent_board_are_distinguished(laptop: GraphLaptop) -> None:
    laptop.execute("sim", "scan", "silent")
    laptop.wait_for_findings("topic-silent")
    laptop.execute("sim", "board", "silent")
    laptop.wait_for_findings("board-wedged", "topic-silent")
    laptop.execute("sim", "scan", "none")
    laptop.execute("sim", "board", "none")
    laptop.wait_for_findings()
    with laptop.participant("camera", "works"):
        laptop.wait_for_findings("camera-silent")
    laptop.wait_for_findings()


def test_unconfigured_controllers_explain_silent_topics(laptop: GraphLaptop) -> None:
    with laptop.host.robot.with_fault("controllers-stuck"):
        graph = laptop.wait_for_findings("controllers-not-active")
        assert {controller.state for controller in graph.controllers or ()} == {"unconfigured"}
    laptop.wait_for_findings()
