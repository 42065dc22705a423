"""The graph probe against graphs of real nodes: faults are found, a healthy graph gives no finding, every wait is bounded."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import controllers, drive, ground_truth, motor_board, topic_delivery
from lupin_cli.checks.base import Snapshot
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.base import Facts
from lupin_cli.facts.graph import Graph, Graphs, parse
from lupin_runtime import graph
from lupin_runtime.stack import graph_probe, graph_session
from lupin_runtime.stack.known_graphs import known_graphs
from lupin_runtime.stack.runs import create_run
from lupin_runtime.stack.service_calls import CALL_TIMEOUT_S, ServiceCalls
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from tests.conftest import GraphHost

CHECKS = (*controllers.CHECKS, *drive.CHECKS, *topic_delivery.CHECKS, *motor_board.CHECKS)


def probe() -> Graph:
    """Return the probed graph of this test."""
    command = [sys.executable, "-m", "lupin_runtime.stack.graph_probe", "--here"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert answer.returncode == 0, answer.stderr
    return read(answer.stdout)


def read(text: str) -> Graph:
    return parse(Output(0, '{"graphs": [{"name": "test", "kind": "sim", ' + text.strip()[1:] + "]}")).graphs[0]


def ids(seen: Graph) -> list[str]:
    diagnosis = diagnose(CHECKS, Snapshot(Facts("laptop", {"graph": Graphs((seen,))}), None))
    assert diagnosis.check_errors == ()
    return sorted(root.finding.id for root in diagnosis.roots)


def wait_until_found(*expected: str) -> None:
    """Probe until exactly these are the root causes: the doctor probes again, too, since a busy moment makes a topic silent."""
    found: list[str] = []

    def is_expected() -> bool:
        found[:] = ids(probe())
        return found == sorted(expected)

    wait_until(is_expected, lambda: f"{sorted(expected)}, found {found}")


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Start simulated robots as processes, and wait until they publish."""
    running: list[subprocess.Popen[bytes]] = []

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        folder = tmp_path / str(len(running))
        command = [sys.executable, "-m", "lupin_sim", "--world", "walled", "--no-cameras", "--run-dir", str(folder), *arguments]
        running.append(subprocess.Popen(command))

        def publishes() -> bool:
            assert running[-1].poll() is None
            return (folder / "sim_state.json").exists()

        wait_until(publishes, "the simulated robot")
        return running[-1]

    yield start
    for process in running:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait(timeout=60)


@pytest.mark.graph
def test_healthy_simulated_robot_gives_no_finding(robot: Callable[..., Any]) -> None:
    robot()
    seen = probe()
    assert ids(seen) == []
    assert [controller.state for controller in seen.controllers or ()] == ["active"] * 5
    assert all(count for _, count in seen.samples) and graph.SCAN.name in dict(seen.samples)
    assert all(call.round_trip_s is not None for call in seen.calls) and len(seen.calls) == 2
    assert not any("lupin_probe" in name for name in seen.nodes)


@pytest.mark.graph
def test_unconfigured_controllers_are_the_root_cause(robot: Callable[..., Any]) -> None:
    robot("--controllers", "unconfigured")
    wait_until_found("controllers-not-active")


@pytest.mark.graph
def test_robot_hung_after_discovery_gives_names_but_no_samples(
    robot: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    process = robot()
    listen, call = graph_session.GraphSession.subscribe, ServiceCalls.begin
    stopped = []

    def stop_and_subscribe(self: graph_session.GraphSession, topics: dict[str, Any]) -> None:
        # Node names arrive later than topic names.
        if all(row.name in topics for row in graph_session.ROBOT_TOPICS) and len(self.node.get_node_names()) > 1:
            os.kill(process.pid, signal.SIGSTOP)
            stopped.append(process.pid)
            listen(self, topics)

    def call_the_stopped(self: ServiceCalls) -> None:
        if stopped:  # a response from before the stop would show a working connection
            call(self)

    monkeypatch.setattr(graph_session.GraphSession, "subscribe", stop_and_subscribe)
    monkeypatch.setattr(ServiceCalls, "begin", call_the_stopped)
    monkeypatch.setattr(graph_session, "SILENCE_TIMEOUT_S", 4.0)
    seen = read(json.dumps(graph_session.probe_graph()))
    assert len(seen.nodes) >= 1 and len(seen.samples) >= 5
    assert ids(seen) == ["names-no-samples"]


@pytest.mark.graph
def test_listed_server_that_never_matches_is_not_silent(graph_host: GraphHost) -> None:
    from std_srvs.srv import Trigger

    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.interfaces import interface

    talker = graph_host.add(LupinNode("talker"))
    scan, laser = talker.publisher(graph.SCAN), interface(graph.SCAN.type)
    talker.create_timer(0.05, lambda: scan.publish(laser()))
    # A different type, so that no client matches them; on a busy machine that can happen for as long as a probe takes.
    for row in (graph.LIST_CONTROLLERS, graph.ARM_LIBRARY_LIST):
        talker.create_service(Trigger, row.name, lambda _, answer: answer)
    seen = probe()
    assert (
        dict(seen.samples)[graph.SCAN.name] and [(call.sent, call.round_trip_s) for call in seen.calls] == [(False, None)] * 2
    )
    assert "one-way-data" not in ids(seen) and "controller-manager-silent" not in ids(seen)


@pytest.mark.graph
def test_topic_below_its_rate_is_observed_long_enough(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.interfaces import interface

    talker = graph_host.add(LupinNode("talker"))
    scan, joints = (partial(talker.publisher(row).publish, interface(row.type)()) for row in (graph.SCAN, graph.JOINT_STATES))
    talker.create_timer(1.0, scan)
    talker.create_timer(0.02, lambda: [joints() for _ in range(5)])  # five times its rate, of which a slow machine keeps one
    seen = probe()
    truth = ground_truth.measure(Snapshot(Facts("laptop", {"graph": Graphs((seen,))}), None))
    states = {report.name: report.state for report in truth.topics}
    # A probe that lacked processor time judges no rate.
    below = ground_truth.UNTIMED if (seen.busy or 0.0) >= ground_truth.BUSY else ground_truth.SLOW
    assert states[graph.SCAN.name] == below and states[graph.JOINT_STATES.name] == ground_truth.LATE  # its stamps are 0


@pytest.mark.graph
def test_faults_of_real_nodes_give_exactly_their_findings(graph_host: GraphHost) -> None:
    from lupin_runtime.drive.twist import ZERO, encode
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.interfaces import interface

    talker = graph_host.add(LupinNode("talker"))
    scan, battery = talker.publisher(graph.SCAN), talker.publisher(graph.BATTERY)
    manual, stop = talker.publisher(graph.CMD_VEL_MANUAL), talker.publisher(graph.ESTOP_STATE)
    talker.publisher(graph.CMD_VEL_SINK_ROBOT)
    laser, state, pressed = (interface(row.type) for row in (graph.SCAN, graph.BATTERY, graph.ESTOP_STATE))

    def speak() -> None:
        scan.publish(laser())  # without frame and stamp
        battery.publish(state(percentage=math.nan))
        stop.publish(pressed(data=True))
        manual.publish(encode(ZERO))

    talker.create_timer(0.05, speak)
    listener = graph_host.add(LupinNode("listener"))
    listener.subscription(graph.SCAN, lambda _: None, qos=graph.REL10)
    listener.subscription(graph.ESTOP_STATE, lambda _: None)

    wait_until_found(
        "battery-unreadable",
        "controller-manager-missing",
        "drive-bypassed",
        "estop-engaged",
        "estop-forged",
        "frame-wrong",
        "qos-mismatch",
        "stamps-wrong",
    )


SPEAKER = """
import rclpy
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
rclpy.init(args=[])
node = LupinNode("speaker")
messages = [(node.publisher(row), interface(row.type)()) for row in (graph.SCAN, graph.ODOM, graph.BATTERY)]
node.create_timer(0.1, lambda: [publisher.publish(message) for publisher, message in messages])
print("up", flush=True)
rclpy.spin(node)
"""


PROBE = """
import json, os, subprocess, sys
from lupin_runtime.stack import graph_probe
from lupin_runtime.stack.known_graphs import KnownGraph
alone = ["unshare", "--mount", "sh", "-c", "mount -t tmpfs tmpfs /dev/shm && exec \\"$@\\"", "sh"]
speaker = subprocess.Popen([*alone, sys.executable, "-c", sys.argv[1]], stdout=subprocess.PIPE, text=True)
try:
    assert speaker.stdout.readline() == "up\\n"
    print(json.dumps({"graphs": graph_probe.probe_all((KnownGraph("run", "sim", dict(os.environ)),))}))
finally:
    speaker.kill()
    speaker.communicate()
"""


@pytest.mark.graph
@pytest.mark.host
@pytest.mark.usefixtures("private_mounts")  # its own /dev/shm
def test_separate_shared_memory_is_found_and_udp_fixes_it() -> None:
    unset = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")
    environment = {key: value for key, value in os.environ.items() if key not in unset}
    # In their own network namespace both use the default transports, and no packet leaves it.
    alone = ["unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"]
    command = [*alone, sys.executable, "-c", PROBE, SPEAKER]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=90)
    assert done.returncode == 0, done.stderr
    (seen,) = parse(Output(0, done.stdout)).graphs
    assert [count for _, count in seen.samples] == [0, 0, 0] and seen.udp_heard == 3
    diagnosis = diagnose(CHECKS, Snapshot(Facts("laptop", {"graph": Graphs((seen,))}), None))
    (root,) = [root for root in diagnosis.roots if root.finding.id == "names-no-samples"]
    assert root.finding.fix.command == "export FASTDDS_BUILTIN_TRANSPORTS=UDPv4"


@pytest.mark.graph
def test_empty_graph_gives_no_finding() -> None:
    seen = probe()
    assert seen.nodes == () and ids(seen) == []


def test_request_whose_response_was_lost_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now_s=0.0)
    monkeypatch.setattr("lupin_runtime.stack.service_calls.time", SimpleNamespace(monotonic=lambda: clock.now_s))
    sent: list[Future[SimpleNamespace]] = []

    def call_async(_request: object) -> Future[SimpleNamespace]:
        sent.append(Future())
        return sent[-1]

    client = SimpleNamespace(service_is_ready=lambda: True, call_async=call_async)
    row = graph.LIST_CONTROLLERS
    calls = ServiceCalls(SimpleNamespace(get_service_names_and_types=lambda: [(row.name, [row.type])], client=lambda _: client))
    calls.begin()
    for clock.now_s, requests in ((1.0, 1), (1.1, 1), (1.5, 1), (2.0, 2)):
        calls.advance()
        assert len(sent) == requests and calls.waited_for() == [(1.0, CALL_TIMEOUT_S)]
    sent[1].set_result(SimpleNamespace(controller=[]))
    clock.now_s = 2.1
    calls.advance()
    assert calls.outcomes == {row.name: {"answered": True, "round_trip_s": pytest.approx(0.1)}}
    assert calls.controllers == [] and not calls.waited_for() and calls.drop_late(2.2) == []


def test_probe_that_hangs_is_killed_and_reported() -> None:
    process = subprocess.Popen(["sleep", "600"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    result = graph_probe._finish(process, time.monotonic() + 0.2)
    assert "did not finish" in result["error"] and process.poll() is not None


def test_probe_that_fails_reports_its_last_error_line() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", "raise SystemExit('no such middleware')"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    result = graph_probe._finish(process, time.monotonic() + 30)
    assert result["error"] == "the graph probe exited with status 1: no such middleware"


def test_known_graphs_are_live_runs_and_the_robot_once_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_graph_probe_refuses_unknown_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    assert graph_probe.main(["--everything"]) == 2
    assert "--here" in capsys.readouterr().err
