"""What keeps the laptop from the robot's network: a cable, a WiFi, a VPN, or a network of the laptop itself."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Finding
from lupin_cli.checks.ground_truth import CHECKS as GROUND_TRUTH
from lupin_cli.checks.path import CHECKS as PATH
from lupin_cli.connection import Output
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.graph import Graph, Graphs
from lupin_cli.facts.networkmanager import NETWORK_MANAGER
from lupin_cli.facts.routes import RouteEntry, RoutingTable
from lupin_cli.link.path import End, Path
from tests.lupin_cli.checks.conftest import CHECKS
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines

CABLE, ACCESS_POINT = "10.42.0.1", "192.168.42.1"
HOME = Address("wlp2s0", "192.168.1.20", 24, "global", up=True, carrier=True)
AT_HOME = (RouteEntry("default", "wlp2s0", "192.168.1.1"), RouteEntry("192.168.1.0/24", "wlp2s0", "", "192.168.1.20"))


def network_manager(*devices: str, profiles: tuple[str, ...] = ("Mirte-247264",)) -> Any:
    """Return NetworkManager with WiFi on the network `home` and these devices, and with saved profiles."""
    saved = [f"{name}:802-11-wireless:yes:0:no" for name in profiles]
    lines = ["@@ devices", "wlp2s0:wifi:connected:home", *devices, "@@ profiles", "home:802-11-wireless:yes:0:yes", *saved]
    return NETWORK_MANAGER.parse(Output(0, "\n".join(lines)))


def elsewhere(machines: Machines, address: str, manager: Any, kind: str = "timeout", **link: Any) -> Machines:
    """Return a laptop whose WiFi is at home; `address` of the robot is beyond its default route."""
    line = f"{address} via 192.168.1.1 dev wlp2s0 src 192.168.1.20"
    away = machines if kind == "" else machines.unreachable(kind)
    away = away.with_laptop("routes", RoutingTable(AT_HOME, frozenset({"wlp2s0"}), {address: (line,)}))
    away = away.with_laptop("addresses", Addresses((HOME,))).with_laptop("ros-processes", ())
    away = away.with_laptop("network-manager", manager)
    return replace(away, link=replace(present(away.link), address=address, **link))


# -- the WiFi, or the cable -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("link", [{"address": ACCESS_POINT}, {"address": "192.168.7.1", "transport": "ap"}])
def test_wifi_has_left_the_robots_access_point(healthy: Machines, link: dict[str, Any]) -> None:
    (finding,) = elsewhere(healthy, manager=network_manager(), **link).root_findings()
    assert (finding.id, finding.fix.command) == ("wifi-roamed", "nmcli connection up Mirte-247264")


def test_access_point_of_several_is_chosen_by_a_person(healthy: Machines) -> None:
    several = network_manager(profiles=("Mirte-1", "Mirte-2"))
    (finding,) = elsewhere(healthy, ACCESS_POINT, several).root_findings()
    assert finding.id == "wifi-roamed" and "has left Mirte-1 or Mirte-2 for home" in finding.cause
    assert finding.fix.command == "nmcli device wifi list"


def test_robot_that_answers_over_a_gateway_lacks_no_wifi(healthy: Machines) -> None:
    for address in (CABLE, ACCESS_POINT):
        assert "wifi-roamed" not in elsewhere(healthy, address, network_manager(), kind="").root_ids()


def test_cable_that_was_pulled_is_no_wifi_that_roamed(healthy: Machines) -> None:
    pulled = network_manager("enp3s0:ethernet:unavailable:")
    for link in ({}, {"transport": "wired"}):
        (finding,) = elsewhere(healthy, CABLE, pulled, **link).root_findings()
        assert (finding.id, finding.where) == ("no-carrier", "link")
        assert "enp3s0" in finding.cause and "nmcli device: enp3s0:ethernet:unavailable:" in finding.evidence
    plugged_in = network_manager("enp3s0:ethernet:disconnected:")
    two = network_manager("enp3s0:ethernet:unavailable:", "enp4s0:ethernet:unavailable:")
    for machines in (
        elsewhere(healthy, CABLE, plugged_in),
        elsewhere(healthy, CABLE, two),
        elsewhere(healthy, CABLE, pulled, kind="refused"),
        elsewhere(healthy, "192.168.0.50", pulled, transport="router"),
    ):
        assert machines.root_ids() == ["robot-unreachable"]


@pytest.mark.parametrize(
    ("interface", "word", "action", "where"),
    [
        ("lan0", "the cable is unplugged", "plug the cable into lan0", "link"),
        ("wlp2s0", "it is in no WiFi", "join the robot's WiFi", "link"),
        ("wifi0", "it is in no WiFi", "join the robot's WiFi", "link"),
        ("wg0", "its VPN is not connected", "connect the VPN", "laptop"),
    ],
)
def test_only_a_cable_is_plugged_in(healthy: Machines, interface: str, word: str, action: str, where: str) -> None:
    near = Addresses((Address(interface, "10.42.0.2", 24, "global", up=True, carrier=False),))
    routes = RoutingTable((RouteEntry("10.42.0.0/24", interface, dead=True),), frozenset({"wifi0"}))
    faulty = healthy.unreachable("no-route").with_laptop("addresses", near).with_laptop("routes", routes)
    (finding,) = faulty.root_findings()
    assert (finding.id, finding.where) == ("no-carrier", where)
    assert word in finding.cause and action in finding.fix.instruction


# -- networks of the laptop itself ----------------------------------------------------------------------------------------


def roots_with_path(machines: Machines, path: Path) -> list[Finding]:
    """Return the root causes while nothing of the robot arrives and the path was measured."""
    empty = Graphs((Graph("robot", "robot", (("ROS_DISCOVERY_SERVER", f"{path.address}:11811"),)),))
    snapshot = replace(machines.with_laptop("graph", empty).snapshot, path=path)
    return [root.finding for root in diagnose((*GROUND_TRUTH, *CHECKS, *PATH), snapshot).roots]


def sharing(machines: Machines, kind: str, manager: Any = "no-network-manager") -> Machines:
    """Return a laptop that shares its connection over enp3s0, by which it takes the robot's address."""
    own = Address("enp3s0", CABLE, 24, "global", up=True, carrier=True)
    line = f"local {CABLE} dev lo table local src {CABLE} uid 1000"
    routes = RoutingTable((RouteEntry("10.42.0.0/24", "enp3s0", "", CABLE),), to_robot={CABLE: (line,)})
    away = machines.unreachable(kind) if kind else machines.with_robot("addresses", Addresses((own,)))
    away = away.with_laptop("addresses", Addresses((own, HOME))).with_laptop("routes", routes)
    return away.with_laptop("ros-processes", ()).with_laptop("network-manager", manager)


@pytest.mark.parametrize("kind", ["refused", "host-key-changed", "host-key-unknown", "authentication", "timeout"])
def test_own_address_of_the_laptop_is_no_robot(healthy: Machines, kind: str) -> None:
    (finding,) = sharing(healthy, kind).root_findings()
    assert (finding.id, finding.layer, finding.where) == ("network-conflict", "address", "laptop")
    assert "10.42.0.1 is this laptop's own address (enp3s0)" in finding.cause
    assert finding.fix.command == "sudo ip address del 10.42.0.1/24 dev enp3s0"
    (finding,) = sharing(healthy, kind, network_manager("enp3s0:ethernet:connected:Wired 1")).root_findings()
    assert finding.fix.command.startswith("nmcli connection modify 'Wired 1' ipv4.method auto ")
    path = Path(CABLE, End("laptop", "lo", CABLE, "", 65536), answers={7399: "refused", 7599: "refused", 11811: "refused"})
    assert [each.id for each in roots_with_path(sharing(healthy, kind), path)] == ["network-conflict"]


def test_laptop_that_answers_in_the_robots_place_is_named(healthy: Machines) -> None:
    path = Path(CABLE, End("laptop", "lo", CABLE, "", 65536))
    reached = sharing(healthy, "").with_laptop("addresses", lambda found: replace(found, entries=found.entries[:1]))
    without_units = reached.with_robot("units", lambda units: replace(units, units=()))
    assert "network-conflict" in [each.id for each in roots_with_path(without_units, path)]
    assert "network-conflict" not in [each.id for each in roots_with_path(reached, path)]  # the doctor runs on the robot


@pytest.mark.parametrize(("bridge", "dockers"), [("docker0", True), ("br-0123456789ab", True), ("virbr0", False)])
@pytest.mark.parametrize("carrier", [True, False])
def test_network_of_containers_leads_to_no_robot(healthy: Machines, bridge: str, dockers: bool, carrier: bool) -> None:
    address = "172.17.4.9"
    own = Address(bridge, "172.17.0.1", 16, "global", up=True, carrier=carrier)
    line = f"{address} dev {bridge} src 172.17.0.1 uid 1000{'' if carrier else ' linkdown'}"
    bridged = RouteEntry("172.17.0.0/16", bridge, "", own.address, dead=not carrier)
    routes = RoutingTable((*AT_HOME, bridged), to_robot={address: (line,)})
    faulty = healthy.unreachable("no-route").with_laptop("addresses", Addresses((own, HOME))).with_laptop("routes", routes)
    faulty = replace(faulty.with_laptop("ros-processes", ()), link=replace(present(faulty.link), address=address))
    path = Path(address, End("laptop", bridge, "172.17.0.1", "", 1500))
    for roots in (faulty.root_findings(), roots_with_path(faulty, path)):
        (finding,) = roots
        assert (finding.id, finding.where) == ("network-conflict", "laptop")
        assert bridge in finding.cause and "cable" not in finding.cause + finding.fix.instruction
        assert ("/etc/docker/daemon.json" in finding.fix.instruction) == dockers
