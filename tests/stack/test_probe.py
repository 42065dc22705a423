"""A visit to graphs of real nodes: what is broken on them is seen, what works gives nothing, and nothing keeps a visitor."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lupin_cli.checks import board, controllers, drive, samples
from lupin_cli.checks.base import Evidence
from lupin_cli.diagnosis import diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.graph import Graph, Graphs, parse
from lupin_cli.target.base import Output
from lupin_runtime import graph
from lupin_runtime.stack import probe
from lupin_runtime.stack.graphs import known_graphs
from lupin_runtime.stack.runs import create_run

CHECKS = (*controllers.CHECKS, *drive.CHECKS, *samples.CHECKS, *board.CHECKS)


def visit() -> Graph:
    """What a visitor of this test's graph sees."""
    command = [sys.executable, "-m", "lupin_runtime.stack.probe", "--here"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert answer.returncode == 0, answer.stderr
    return read(answer.stdout)


def read(told: str) -> Graph:
    return parse(Output(0, '{"graphs": [{"name": "test", "kind": "sim", ' + told.strip()[1:] + "]}")).graphs[0]


def ids(seen: Graph) -> list[str]:
    diagnosis = diagnose(CHECKS, Evidence(Facts("laptop", {"graph": Graphs((seen,))}), None))
    assert diagnosis.broken == ()
    return sorted(root.finding.id for root in diagnosis.roots)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen]]:
    """Starts simulated robots as processes and waits until their world turns."""
    running: list[subprocess.Popen] = []

    def start(*arguments: str) -> subprocess.Popen:
        folder = tmp_path / str(len(running))
        command = [sys.executable, "-m", "lupin_sim", "--world", "walled", "--no-cameras", "--run-dir", str(folder), *arguments]
        running.append(subprocess.Popen(command))
        deadline = time.monotonic() + 60
        while not (folder / "sim_state.json").exists():
            assert running[-1].poll() is None and time.monotonic() < deadline, "the simulated robot did not come up"
            time.sleep(0.05)
        return running[-1]

    yield start
    for process in running:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait(timeout=20)


@pytest.mark.graph
def test_a_simulated_robot_that_works_gives_nothing(robot) -> None:
    robot()
    seen = visit()
    assert ids(seen) == []
    assert [controller.state for controller in seen.controllers or ()] == ["active"] * 5
    assert all(count for _, count in seen.samples) and graph.SCAN.name in dict(seen.samples)
    assert all(call.round_trip_s is not None for call in seen.calls) and len(seen.calls) == 2
    assert not any("lupin_probe" in name for name in seen.nodes)


@pytest.mark.graph
def test_controllers_that_the_vendors_race_left_unconfigured_are_the_root(robot) -> None:
    robot("--controllers", "unconfigured")
    assert ids(visit()) == ["controllers-not-active"]


@pytest.mark.graph
def test_a_robot_that_stops_once_its_names_are_known_gives_names_and_no_samples(robot, monkeypatch) -> None:
    process = robot()
    listen, call = probe.Visit.listen, probe.Visit.call
    stopped = []

    def stop_and_listen(self: probe.Visit, topics: dict) -> None:
        # Names of nodes come later than those of topics.
        if all(row.name in topics for row in probe.ROBOTS) and len(self.node.get_node_names()) > 1:
            os.kill(process.pid, signal.SIGSTOP)
            stopped.append(process.pid)
            listen(self, topics)

    def call_the_stopped(self: probe.Visit) -> None:
        if stopped:  # an answer from before would tell of a line that works
            call(self)

    monkeypatch.setattr(probe.Visit, "listen", stop_and_listen)
    monkeypatch.setattr(probe.Visit, "call", call_the_stopped)
    monkeypatch.setattr(probe, "SILENCE_BOUND_S", 4.0)
    started = time.monotonic()
    seen = read(json.dumps(probe.look()))
    assert time.monotonic() - started < probe.VISIT_BOUND_S
    assert len(seen.nodes) >= 1 and len(seen.samples) >= 5
    assert ids(seen) == ["names-no-samples"]


@pytest.mark.graph
def test_a_server_that_is_listed_and_never_found_is_not_called_silent(graph_host) -> None:
    from std_srvs.srv import Trigger

    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.node import interface

    talker = graph_host.add(LupinNode("talker"))
    scan, laser = talker.publisher(graph.SCAN), interface(graph.SCAN.type)
    talker.create_timer(0.05, lambda: scan.publish(laser()))
    # Of another type, so that no client of the right one ever meets them; on a busy machine that may take as long as a visit.
    for row in (graph.LIST_CONTROLLERS, graph.ARM_LIBRARY_LIST):
        talker.create_service(Trigger, row.name, lambda _, answer: answer)
    seen = visit()
    assert dict(seen.samples)[graph.SCAN.name] and not seen.calls
    assert "one-way-data" not in ids(seen) and "controller-manager-silent" not in ids(seen)


@pytest.mark.graph
def test_every_fault_of_a_graph_of_real_nodes_is_named_and_no_other(graph_host) -> None:
    from lupin_runtime.drive.twist import ZERO, encode
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.node import interface

    talker = graph_host.add(LupinNode("talker"))
    scan, battery = talker.publisher(graph.SCAN), talker.publisher(graph.BATTERY)
    manual, stop = talker.publisher(graph.CMD_VEL_MANUAL), talker.publisher(graph.ESTOP_STATE)
    talker.publisher(graph.CMD_VEL_SINK_ROBOT)
    laser, state, pressed = (interface(row.type) for row in (graph.SCAN, graph.BATTERY, graph.ESTOP_STATE))

    def speak() -> None:
        scan.publish(laser())
        battery.publish(state(percentage=math.nan))
        stop.publish(pressed(data=True))
        manual.publish(encode(ZERO))

    talker.create_timer(0.05, speak)
    listener = graph_host.add(LupinNode("listener"))
    listener.subscription(graph.SCAN, lambda _: None, qos=graph.REL10)
    listener.subscription(graph.ESTOP_STATE, lambda _: None)

    assert ids(visit()) == [
        "battery-unreadable",
        "controller-manager-missing",
        "estop-engaged",
        "qos-mismatch",
    ]


SPEAKER = """
import rclpy
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.node import interface
rclpy.init(args=[])
node = LupinNode("speaker")
said = [(node.publisher(row), interface(row.type)()) for row in (graph.SCAN, graph.ODOM, graph.BATTERY)]
node.create_timer(0.1, lambda: [publisher.publish(message) for publisher, message in said])
print("up", flush=True)
rclpy.spin(node)
"""


VISITOR = """
import json, os, subprocess, sys
from lupin_runtime.stack import probe
from lupin_runtime.stack.graphs import KnownGraph
alone = ["unshare", "--mount", "sh", "-c", "mount -t tmpfs tmpfs /dev/shm && exec \\"$@\\"", "sh"]
speaker = subprocess.Popen([*alone, sys.executable, "-c", sys.argv[1]], stdout=subprocess.PIPE, text=True)
try:
    assert speaker.stdout.readline() == "up\\n"
    print(json.dumps({"graphs": probe.visit_all((KnownGraph("run", "sim", dict(os.environ)),))}))
finally:
    speaker.kill()
    speaker.communicate()
"""


@pytest.mark.graph
@pytest.mark.host
@pytest.mark.usefixtures("own_mounts")  # a /dev/shm of its own
def test_two_sides_that_cannot_share_memory_see_names_and_no_samples_and_udp_is_the_cure() -> None:
    unset = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")
    environment = {key: value for key, value in os.environ.items() if key not in unset}
    # On a network of their own both use the transports that nobody chose, and no packet leaves it.
    alone = ["unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"]
    command = [*alone, sys.executable, "-c", VISITOR, SPEAKER]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=90)
    assert done.returncode == 0, done.stderr
    (seen,) = parse(Output(0, done.stdout)).graphs
    assert [count for _, count in seen.samples] == [0, 0, 0] and seen.udp_heard == 3
    diagnosis = diagnose(CHECKS, Evidence(Facts("laptop", {"graph": Graphs((seen,))}), None))
    (root,) = [root for root in diagnosis.roots if root.finding.id == "names-no-samples"]
    assert root.finding.fix.command == "export FASTDDS_BUILTIN_TRANSPORTS=UDPv4"


@pytest.mark.graph
def test_an_empty_graph_is_left_soon() -> None:
    seen = visit()
    assert seen.nodes == () and ids(seen) == []


def test_a_visitor_that_does_not_end_is_ended_and_said_to_have_hung(monkeypatch: pytest.MonkeyPatch) -> None:
    process = subprocess.Popen(["sleep", "600"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    told = probe._finish(process, time.monotonic() + 0.2)
    assert "did not end" in told["error"] and process.poll() is not None


def test_a_visitor_that_dies_leaves_its_last_words() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", "raise SystemExit('no such middleware')"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    told = probe._finish(process, time.monotonic() + 30)
    assert told["error"] == "the visit to the graph ended with 1: no such middleware"


def test_graphs_are_those_of_live_runs_and_of_the_robot_each_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    base = {"HOME": str(tmp_path), "PATH": os.environ["PATH"], "ROS_DOMAIN_ID": "7", "ROS_LOCALHOST_ONLY": "1"}
    assert known_graphs(base) == ()

    run, lock = create_run()
    run.write_info({"environment": {"ROS_DOMAIN_ID": "42"}, "options": {"target": "sim"}})
    config = tmp_path / ".config" / "lupin"
    config.mkdir(parents=True)
    (config / "ros-env.sh").write_text('export ROS_DISCOVERY_SERVER="10.42.0.1:11811"\n')
    found = known_graphs(base)
    assert [(each.name, each.kind) for each in found] == [(run.id, "sim"), ("robot", "robot")]
    assert found[0].environment["ROS_DOMAIN_ID"] == "42"
    assert "ROS_LOCALHOST_ONLY" not in found[0].environment
    assert found[1].environment["ROS_DISCOVERY_SERVER"] == "10.42.0.1:11811"

    run.write_info({"environment": dict(found[1].environment), "options": {"target": "robot"}})
    assert [(each.name, each.kind) for each in known_graphs(base)] == [(run.id, "robot")]
    os.close(lock)
    assert [each.name for each in known_graphs(base)] == ["robot"]


def test_unknown_arguments_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert probe.main(["--everything"]) == 2
    assert "--here" in capsys.readouterr().err
