"""The path between two machines, measured in two network namespaces with a cable between them, and judged.

Policy routing takes packets away as a firewall would, since a machine need not have a packet filter installed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks import ground_truth
from lupin_cli.checks import path as path_checks
from lupin_cli.checks.base import Snapshot
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import Diagnosis, diagnose
from lupin_cli.facts.addresses import ADDRESSES, Addresses
from lupin_cli.facts.base import Facts
from lupin_cli.facts.graph import Graph, Graphs
from lupin_cli.facts.link import Link
from lupin_cli.facts.sockets import parse as parse_sockets
from lupin_cli.link import path_agent
from lupin_cli.link.path import Knock
from lupin_cli.link.path import Path as MeasuredPath
from lupin_cli.link.path_measurement import BURST, measure_path
from lupin_cli.link.quality import Ping
from lupin_sim.host.namespaces import hold_new_namespaces
from lupin_sim.host.network import LINK_EMULATOR
from tests.support.findings import assert_findings_match_rows
from tests.support.optional import present
from tests.support.waiting import wait_until

pytestmark = [pytest.mark.host, pytest.mark.usefixtures("private_mounts")]

LAPTOP, ROBOT = "10.42.0.2", "10.42.0.1"
SERVER_PORT = 11811
READER = """
import socket, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(("0.0.0.0", {port}))
print("up", flush=True)
while {reads}: s.recv(65536)
time.sleep(600)
"""
SENDER = """
import socket, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
print("up", flush=True)
while True:
    s.sendto(b"x", ("10.42.0.1", 9999))
    time.sleep(0.002)
"""
LISTENER = """
import socket, time
s = socket.create_server(("0.0.0.0", 22))
print("up", flush=True)
time.sleep(600)
"""


ALIVE, DEAD = Ping(6, 6, (0.4,) * 6), Ping(6, 0, ())


@dataclass
class Machine:
    """A network namespace with one interface, and the agent in it."""

    interface: str
    holder: subprocess.Popen[bytes] = field(default_factory=lambda: hold_new_namespaces("net", "mnt"))
    children: list[subprocess.Popen[str]] = field(default_factory=list)
    agent: subprocess.Popen[str] | None = None

    def __post_init__(self) -> None:
        assert self.holder.stdout is not None
        self.holder.stdout.readline()
        self.run("mount", "-t", "sysfs", "sysfs", "/sys")
        self.run("ip", "link", "set", "lo", "up")

    def command(self, *words: str) -> list[str]:
        return ["nsenter", "--target", str(self.holder.pid), "--net", "--mount", "--", *words]

    def run(self, *words: str) -> None:
        done = subprocess.run(self.command(*words), capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, f"{words}: {done.stderr}"

    def start(self, *words: str) -> subprocess.Popen[str]:
        command = self.command(*words)
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        self.children.append(child)
        return child

    def bind(self, port: int, *, reads: bool = True) -> None:
        """Run a program that owns a UDP port, and reads it or not."""
        child = self.start(sys.executable, "-I", "-S", "-c", READER.format(port=port, reads=reads))
        assert child.stdout is not None and child.stdout.readline() == "up\n"

    def ask(self, do: str, **arguments: Any) -> Any:
        """See `lupin_cli.link.path_peers.Peer`."""
        if self.agent is None:
            self.agent = self.start(sys.executable, "-I", "-S", path_agent.__file__)
        assert self.agent.stdin is not None and self.agent.stdout is not None
        self.agent.stdin.write(json.dumps({"do": do, **arguments}) + "\n")
        return json.loads(self.agent.stdout.readline())

    def addresses(self) -> Addresses:
        """Return its addresses, as the doctor reads them."""
        done = subprocess.run(self.command("sh", "-c", ADDRESSES.probe), capture_output=True, text=True, timeout=60)
        return ADDRESSES.parse(Output(done.returncode, done.stdout, done.stderr))

    def drop(self, *selector: str) -> None:
        """Drop packets that match a selector of ip-rule(8), before any socket gets them or after a program sent them."""
        self.run("ip", "rule", "add", "pref", "100", "lookup", "local")
        self.run("ip", "rule", "delete", "pref", "0")
        self.run("ip", "rule", "add", "pref", "50", *selector, "blackhole")

    def close(self) -> None:
        for child in self.children:
            child.kill()
            child.communicate()
        self.holder.kill()
        self.holder.communicate()


@dataclass
class Cable:
    """A laptop and a robot, a bridge of two cables between them, and what is measured over them."""

    laptop: Machine
    robot: Machine
    middle: Machine
    emulator: subprocess.Popen[str] | None = None

    @classmethod
    def plug(cls) -> Cable:
        cable = cls(Machine("lan0"), Machine("eth0"), Machine("between"))
        for end, address in ((cable.laptop, LAPTOP), (cable.robot, ROBOT)):
            pid = str(end.holder.pid)
            cable.middle.run("ip", "link", "add", f"to-{end.interface}", "type", "veth", "peer", end.interface, "netns", pid)
            cable.middle.run("ip", "link", "set", f"to-{end.interface}", "up")
            end.run("ip", "address", "add", f"{address}/24", "dev", end.interface)
            end.run("ip", "link", "set", end.interface, "up")
        return cable

    def emulate(self, **settings: Any) -> None:
        """Connect the two cables with the link emulator. Without settings, it only forwards."""
        self.emulator = self.middle.start(sys.executable, "-I", str(LINK_EMULATOR), "to-eth0", "to-lan0", json.dumps(settings))
        assert self.emulator.stdout is not None and self.emulator.stdout.readline() == "running\n"

    def addresses(self) -> dict[str, Addresses]:
        """Return the addresses of both machines, once the kernel has noticed the carriers of new interfaces."""

        def settled() -> dict[str, Addresses] | None:
            found = {"laptop": self.laptop.addresses(), "robot": self.robot.addresses()}
            return found if all(each.carrier for machine in found.values() for each in machine.entries if each.up) else None

        return present(wait_until(settled, "a carrier of every interface", 10.0))

    def measure_alone(self) -> MeasuredPath:
        """Measure the path from the laptop alone, as while nobody can log in on the robot."""
        return measure_path(self.laptop, None, ROBOT, lambda: ALIVE)

    def measure(self, ping: Ping = ALIVE) -> MeasuredPath:
        """Measure the path from both ends. ICMP is not part of these tests."""
        return measure_path(self.laptop, self.robot, ROBOT, lambda: ping)

    def close(self) -> None:
        for machine in (self.laptop, self.robot, self.middle):
            machine.close()


@pytest.fixture
def cable() -> Iterator[Cable]:
    cable = Cable.plug()
    yield cable
    cable.close()


def judge(path: MeasuredPath, sockets: str = "", addresses: Mapping[str, Addresses] | None = None) -> Diagnosis:
    """Judge a path while nothing of the robot arrives. `addresses` are those of the machines, if they are known."""
    known = {machine: {"addresses": each} for machine, each in (addresses or {}).items()}
    laptop = {"graph": Graphs((Graph("robot", "robot", ()),)), **known.get("laptop", {})}
    robot = {"sockets": parse_sockets(Output(0, f"@@ sockets\n{sockets}@@ commands\n")), **known.get("robot", {})}
    link = Link("greenhouse", ROBOT, transport="wired")
    asked: Facts | None = Facts("robot", robot)
    if path.robot is None and path.answers:  # nobody could log in there
        asked, link = None, replace(link, kind="refused", message=f"{ROBOT} refuses TCP 22")
    diagnosis = diagnose((*ground_truth.CHECKS, *path_checks.CHECKS), Snapshot(Facts("laptop", laptop), asked, link, path))
    assert_findings_match_rows(diagnosis)
    return diagnosis


def roots(path: MeasuredPath, addresses: Mapping[str, Addresses] | None = None) -> list[tuple[str, str, str]]:
    """Return finding, layer and machine of each root cause."""
    found = [root.finding for root in judge(path, addresses=addresses).roots]
    assert all(finding.evidence and all(finding.evidence) for finding in found)
    return [(finding.id, finding.layer, finding.where) for finding in found]


def test_path_without_fault_delivers_every_packet(cable: Cable) -> None:
    cable.emulate()
    cable.robot.bind(SERVER_PORT)
    path = cable.measure()
    assert path.unmeasured == "" and path.unread == ()
    assert all(burst.delivered > 0.95 for burst in path.bursts), path.bursts
    assert {burst.direction for burst in path.bursts} == {"up", "down"}
    (server,) = [burst for burst in path.bursts if burst.ports == (SERVER_PORT,)]
    assert server.arrived is None and server.tried == BURST
    assert path.answers == {}
    assert roots(path) == [("unexplained", "samples", "link")]


@pytest.mark.parametrize(
    ("machine", "selector", "ports", "direction"),
    [
        ("robot", ("ipproto", "udp", "dport", "11811", "iif", "eth0"), "UDP 11811", "from the laptop to the robot"),
        ("robot", ("ipproto", "udp", "iif", "eth0"), "every UDP packet", "from the laptop to the robot"),
        ("robot", ("ipproto", "udp", "dport", "7400-7500", "iif", "eth0"), "every UDP packet", "from the laptop to the robot"),
        ("laptop", ("ipproto", "udp", "iif", "lan0"), "every UDP packet", "from the robot to the laptop"),
        ("laptop", ("ipproto", "udp", "dport", "7412", "iif", "lan0"), "UDP 7412", "from the robot to the laptop"),
        ("laptop", ("ipproto", "udp", "dport", "11811", "iif", "lo"), "UDP 11811", "from the laptop to the robot"),
    ],
)
def test_blocked_ports_are_named_with_direction_and_machine(
    cable: Cable, machine: str, selector: tuple[str, ...], ports: str, direction: str
) -> None:
    cable.emulate()
    cable.robot.bind(SERVER_PORT)
    getattr(cable, machine).drop(*selector)
    (root,) = judge(cable.measure()).roots
    finding = root.finding
    assert (finding.id, finding.layer, finding.where) == ("udp-lost", "ports", machine), finding
    assert finding.cause.startswith(f"{ports} {direction} is lost on the {machine}")
    assert "the other direction works" in finding.cause and "firewall" in finding.cause
    assert [other.id for other in root.consequences] == ["unexplained"]


def test_ports_lost_in_between_name_both_interfaces(cable: Cable) -> None:
    cable.emulate(blocked_ports=[7400, 11900])
    cable.robot.bind(SERVER_PORT)
    (root,) = judge(cable.measure()).roots
    assert (root.finding.id, root.finding.where) == ("udp-lost", "link")
    assert "between lan0 and eth0" in root.finding.cause and "access point" in root.finding.cause


def test_firewalls_of_both_machines_are_two_roots(cable: Cable) -> None:
    cable.emulate()
    cable.robot.bind(SERVER_PORT)
    cable.robot.drop("ipproto", "udp", "dport", "11811", "iif", "eth0")
    cable.laptop.drop("ipproto", "udp", "dport", "7412", "iif", "lan0")
    assert roots(cable.measure()) == [("udp-lost", "ports", "robot"), ("udp-lost", "ports", "laptop")]


@pytest.mark.parametrize("machine", ["robot", "laptop"])
def test_small_mtu_is_named_on_its_machine(cable: Cable, machine: str) -> None:
    cable.emulate()
    end: Machine = getattr(cable, machine)
    end.run("ip", "link", "set", end.interface, "mtu", "600")
    (root,) = judge(cable.measure()).roots
    assert (root.finding.id, root.finding.layer, root.finding.where) == ("large-packets-lost", "mtu", machine)
    assert f"{end.interface} of the {machine} has an MTU of 600" in root.finding.cause


@pytest.mark.parametrize("machine", ["robot", "laptop"])
def test_permanent_neighbor_entry_is_named(cable: Cable, machine: str) -> None:
    cable.emulate()
    end, other = (cable.robot, LAPTOP) if machine == "robot" else (cable.laptop, ROBOT)
    end.run("ip", "neigh", "replace", other, "lladdr", "02:00:00:00:00:99", "dev", end.interface, "nud", "permanent")
    assert roots(cable.measure()) == [("neighbor-wrong", "address", machine)]


def test_drops_of_other_traffic_are_no_loss_of_a_port(cable: Cable) -> None:
    cable.emulate()
    cable.robot.bind(SERVER_PORT)
    cable.robot.drop("ipproto", "udp", "dport", "9999", "iif", "eth0")
    other = cable.laptop.start(sys.executable, "-I", "-S", "-c", SENDER)
    assert other.stdout is not None and other.stdout.readline() == "up\n"
    assert roots(cable.measure()) == [("unexplained", "samples", "link")]
    cable.robot.run("ip", "rule", "add", "pref", "49", "ipproto", "udp", "dport", str(SERVER_PORT), "iif", "eth0", "blackhole")
    assert roots(cable.measure()) == [("udp-lost", "ports", "robot")]


def test_random_loss_is_no_firewall(cable: Cable) -> None:
    cable.emulate(loss=0.3)
    cable.robot.bind(SERVER_PORT)
    assert roots(cable.measure()) == [("packets-lost", "loss", "link")]


def test_dead_switch_lies_between_the_interfaces(cable: Cable) -> None:
    path = measure_path(cable.laptop, cable.robot, ROBOT, lambda: Ping(6, 0, ()))
    assert roots(path) == [("link-dead", "carrier", "link")]


@pytest.mark.parametrize("machine", ["robot", "laptop"])
def test_missing_route_is_named_on_its_machine(cable: Cable, machine: str) -> None:
    cable.emulate()
    end: Machine = getattr(cable, machine)
    end.run("ip", "route", "flush", "dev", end.interface)
    assert roots(cable.measure())[0] == ("no-route", "route", machine)


@pytest.mark.parametrize("machine", ["robot", "laptop"])
@pytest.mark.parametrize("other", ["", "10.42.188.134/24"])
def test_lost_address_is_named_on_its_machine(cable: Cable, machine: str, other: str) -> None:
    cable.emulate()
    end: Machine = getattr(cable, machine)
    end.run("ip", "address", "flush", "dev", end.interface)
    if other:
        end.run("ip", "address", "add", other, "dev", end.interface)
    assert roots(cable.measure(DEAD), cable.addresses()) == [("address-missing", "address", machine)]


@pytest.mark.parametrize("machine", ["robot", "laptop"])
def test_route_over_another_interface_is_named(cable: Cable, machine: str) -> None:
    cable.emulate()
    end: Machine = getattr(cable, machine)
    end.run("ip", "link", "add", "radio0", "type", "veth", "peer", "name", "radio1")
    for interface in ("radio0", "radio1"):
        end.run("ip", "link", "set", interface, "up")
    end.run("ip", "address", "add", "192.168.42.7/24", "dev", "radio0")
    end.run("ip", "route", "add", f"{ROBOT if machine == 'laptop' else LAPTOP}/32", "dev", "radio0")
    assert roots(cable.measure(), cable.addresses()) == [("route-elsewhere", "route", machine)]


def test_flipped_bits_lie_between_the_interfaces(cable: Cable) -> None:
    cable.emulate(corrupted=0.3)
    cable.robot.bind(SERVER_PORT)
    assert roots(cable.measure()) == [("packets-lost", "loss", "link")]


@pytest.mark.parametrize("machine", ["robot", "laptop"])
def test_limit_of_the_rate_is_loss_of_its_machine(cable: Cable, machine: str) -> None:
    cable.emulate()
    cable.robot.bind(SERVER_PORT)
    end: Machine = getattr(cable, machine)
    limit = ("rate", "64kbit", "burst", "2000", "limit", "1500")  # some 33 small packets a second
    end.run("tc", "qdisc", "add", "dev", end.interface, "root", "tbf", *limit)
    (root,) = judge(cable.measure()).roots
    assert (root.finding.id, root.finding.layer, root.finding.where) == ("packets-lost", "loss", machine)
    assert "something limits their rate" in root.finding.cause
    assert f"a queueing discipline of {end.interface} of the {machine}" in root.finding.cause


@pytest.mark.parametrize(
    ("selector", "cause"),
    [
        (("ipproto", "udp", "dport", "11811", "iif", "eth0"), "UDP 11811 from the laptop to the robot gets no answer"),
        (("ipproto", "udp", "dport", "7400-7600", "iif", "eth0"), "UDP 7599 from the laptop to the robot gets no answer"),
        (("ipproto", "udp", "iif", "eth0"), "no UDP packet from the laptop to the robot is answered"),
    ],
)
def test_blocked_ports_are_named_without_a_login(cable: Cable, selector: tuple[str, ...], cause: str) -> None:
    cable.emulate()
    cable.robot.drop(*selector)
    (root,) = judge(cable.measure_alone()).roots
    assert (root.finding.id, root.finding.layer, root.finding.where) == ("udp-lost", "ports", "link")
    assert root.finding.cause.startswith(cause)


def test_closed_ports_without_a_login_are_no_filter(cable: Cable) -> None:
    cable.emulate()
    path = cable.measure_alone()
    assert set(path.answers.values()) == {"refused"}
    assert roots(path) == [("unexplained", "samples", "link")]


def test_own_filter_that_takes_a_connection_is_counted(cable: Cable) -> None:
    cable.emulate()
    present(cable.laptop.ask("resolve", address=ROBOT, hop=ROBOT, interface="lan0"))
    sshd = cable.robot.start(sys.executable, "-I", "-S", "-c", LISTENER)
    assert sshd.stdout is not None and sshd.stdout.readline() == "up\n"

    def knock() -> Knock:
        return present(measure_path(cable.laptop, None, ROBOT, lambda: ALIVE, sshd=(ROBOT, 22)).knock)

    assert (passing := knock()).unsent == 0 and not passing.loses_answers and passing.answered
    cable.robot.drop("ipproto", "tcp", "dport", "22", "iif", "eth0")
    assert (elsewhere := knock()).unsent == 0 and not elsewhere.loses_answers and not elsewhere.answered
    cable.robot.run("ip", "rule", "delete", "pref", "50")
    cable.laptop.drop("ipproto", "tcp", "sport", "22", "iif", "lan0")
    assert (answers := knock()).unsent == 0 and answers.loses_answers
    cable.laptop.run("ip", "rule", "delete", "pref", "50")
    cable.laptop.run("tc", "qdisc", "add", "dev", "lan0", "root", "bfifo", "limit", "60b")  # ARP passes, TCP does not
    assert (leaving := knock()).unsent > 0 and not leaving.loses_answers


def test_closed_ports_are_found_though_icmp_is_limited(cable: Cable) -> None:
    cable.emulate()
    present(cable.laptop.ask("resolve", address=ROBOT, hop=ROBOT, interface="lan0"))
    # A client of a discovery server that is gone uses up the kernel's answers.
    cable.laptop.ask("send", address=ROBOT, ports=[SERVER_PORT], number=20, size=100, word="", fragment=False, paced=False)
    path = cable.measure_alone()
    assert set(path.answers.values()) == {"refused"}
    # Another one goes on: which of the ports are closed is not known, but none is filtered.
    cable.laptop.start(sys.executable, "-I", "-S", "-c", SENDER)
    assert "silent" not in cable.measure_alone().answers.values()


PING = """
import json, sys
from lupin_cli.connection.local import LocalTarget
from lupin_cli.link.quality import ping
found = ping(LocalTarget(), sys.argv[1], 8, 0.05, 3.0)
print(json.dumps([found.sent, found.received, found.rtts_ms]))
"""


@pytest.mark.parametrize(("settings", "least", "most"), [({}, 8, 8), ({"delay_ms": 400.0}, 8, 8), ({"loss": 1.0}, 0, 0)])
def test_ping_counts_late_replies_of_its_own_requests(cable: Cable, settings: dict[str, float], least: int, most: int) -> None:
    cable.emulate(**settings)
    # Its own, and those of another program at the same time.
    other, child = (cable.laptop.start(sys.executable, "-c", PING, ROBOT) for _ in range(2))
    for each in (other, child):
        output, _ = each.communicate(timeout=60)
        sent, received, rtts_ms = json.loads(output)
        assert sent == 8 and least <= received <= most
        assert all(rtt_ms >= 2 * settings.get("delay_ms", 0.0) for rtt_ms in rtts_ms)


ECHO_BURST = """
import json, sys
from lupin_cli.link.quality import echo_burst
found = echo_burst(sys.argv[1])
print(json.dumps([found.sent, found.received]))
"""


@pytest.mark.parametrize("machine", ["robot", "laptop"])
@pytest.mark.parametrize("rate", ["", "384kbit", "768kbit"])
def test_burst_is_lost_where_the_rate_is_limited(cable: Cable, machine: str, rate: str) -> None:
    cable.emulate()
    end: Machine = getattr(cable, machine)
    if rate:
        end.run("tc", "qdisc", "add", "dev", end.interface, "root", "tbf", "rate", rate, "burst", "3000", "limit", "6000")
    output, _ = cable.laptop.start(sys.executable, "-c", ECHO_BURST, ROBOT).communicate(timeout=60)
    sent, received = json.loads(output)
    assert sent == 40 and received > 0
    assert (received < 0.85 * sent) == bool(rate)


def test_program_that_does_not_read_its_socket_is_named(cable: Cable) -> None:
    cable.emulate()
    cable.robot.bind(SERVER_PORT)
    cable.robot.bind(7412, reads=False)
    (root,) = judge(cable.measure(), 'udp UNCONN 0 0 0.0.0.0:7412 0.0.0.0:* users:(("lidar",pid=77,fd=3))\n').roots
    assert (root.finding.id, root.finding.layer, root.finding.where) == ("socket-not-read", "processes", "robot")
    assert "lidar (process 77) does not read UDP 7412" in root.finding.cause


def test_agent_needs_nothing_of_lupin() -> None:
    command = [sys.executable, "-I", "-S", "-c", Path(path_agent.__file__).read_text(encoding="utf-8")]
    request = '{"do": "bound", "first": 0, "last": 0}\n'
    done = subprocess.run(command, input=request, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("{}\n", "")


def test_silent_agent_on_the_robot_is_what_was_not_measured(cable: Cable) -> None:
    from lupin_cli.link.path_peers import PathError

    cable.emulate()

    class Broken:
        def ask(self, do: str, **_: Any) -> Any:
            raise PathError(f"no answer to {do}")

    path = measure_path(cable.laptop, Broken(), ROBOT, lambda: None)
    assert path.unmeasured == "no answer to describe" and path.robot is None
    assert roots(path) == [("unexplained", "samples", "link")]
