"""Addresses that the laptop has no route to: what the robot announces there, and which server a program asks for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Severity
from lupin_cli.connection import Output
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.routes import ROUTES, RouteEntry, RoutingTable
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines

DEFAULT = RouteEntry("default", "wlp2s0", "192.168.1.1", "192.168.1.20")
CABLE = RouteEntry("10.42.0.0/24", "lan0", "", "10.42.0.2")
ACCESS_POINT = RouteEntry("192.168.42.0/24", "wifi0", "", "192.168.42.2")
UNREACHABLE = "RTNETLINK answers: Network is unreachable"


def announced(*added: tuple[str, str, int], without_access_point: bool = True) -> Any:
    """Return a function that adds interface, address and prefix length to the robot's addresses."""

    def change(own: Addresses) -> Addresses:
        kept = [each for each in own.entries if each.interface != "wlan0" or not without_access_point]
        return Addresses((*kept, *(Address(*each, "global", up=True, carrier=True) for each in added)))

    return change


# -- what the robot announces ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("added", "script"),
    [
        (
            [("eth0", "192.168.1.7", 24)],
            "sudo ip address del 192.168.1.7/24 dev eth0 && sudo systemctl restart mirte-ros.service",
        ),
        ([("usb0", "172.30.0.2", 16)], "sudo ip link set usb0 down && sudo systemctl restart mirte-ros.service"),
        (
            [("usb0", "172.30.0.2", 16), ("docker0", "172.17.0.1", 16), ("eth0", "192.168.1.7", 24)],
            "sudo ip link set usb0 down && sudo ip address del 192.168.1.7/24 dev eth0 && sudo systemctl restart",
        ),
        ([("docker0", "172.17.0.1", 16)], ""),
        ([("tailscale0", "100.101.1.2", 32)], ""),
    ],
)
def test_fix_keeps_the_link_and_what_others_own(healthy: Machines, added: list[tuple[str, str, int]], script: str) -> None:
    (finding,) = healthy.with_robot("addresses", announced(*added)).root_findings()
    assert (finding.id, finding.fix.playbook) == ("robot-multi-homed", "")
    assert script in finding.fix.command and bool(script) == bool(finding.fix.command)
    restricted = "allow only 127.0.0.1 and 10.42.0.1 (interfaceWhiteList)" in finding.fix.instruction
    assert restricted == any(name in ("docker0", "tailscale0") for name, *_ in added)


def test_access_point_goes_before_a_tunnel(healthy: Machines) -> None:
    both = announced(("tailscale0", "100.101.1.2", 32), without_access_point=False)
    faulty = healthy.with_robot("addresses", both).with_robot("discovery-log", lambda log: replace(log, access_point="active"))
    (finding,) = faulty.root_findings()
    assert (finding.fix.playbook, "100.101.1.2" in finding.cause) == ("", True)  # the laptop has a route to the access point
    (finding,) = faulty.with_laptop("routes", lambda found: replace(found, main=(CABLE,))).root_findings()
    assert (finding.fix.playbook, finding.fix.command) == ("single-home", "lupin play single-home --robot mirte")


def test_below_a_tunnel_no_interface_is_switched_off(healthy: Machines) -> None:
    vpn = RouteEntry("100.101.1.2", "tailscale0")
    remote = healthy.with_robot("addresses", announced(("tailscale0", "100.101.1.2", 32)))
    remote = replace(remote, link=replace(present(remote.link), address="100.101.1.2"))
    remote = remote.with_laptop("ros-processes", ()).with_laptop("shell", lambda shell: replace(shell, exports={}))
    routes = RoutingTable((DEFAULT,), others=(vpn,))
    found = {each.id: each for each in remote.with_laptop("routes", routes).root_findings()}
    assert found["robot-multi-homed"].fix.command == ""
    assert "only the default route of the laptop leads to the former" in found["robot-multi-homed"].cause


def test_table_of_a_vpn_leads_to_an_announced_address(healthy: Machines) -> None:
    both = healthy.with_robot("addresses", announced(("tailscale0", "100.101.1.2", 32)))
    vpn = RouteEntry("100.101.1.2", "tailscale0")
    assert both.with_laptop("routes", lambda found: replace(found, others=(vpn,))).root_ids() == []
    assert both.with_laptop("routes", lambda found: replace(found, others=(replace(vpn, dead=True),))).root_ids() != []


def test_gateway_to_the_robot_may_lead_to_all_its_addresses(healthy: Machines) -> None:
    routes = RoutingTable((DEFAULT, RouteEntry("172.17.0.0/16", "docker0")))
    both = healthy.with_robot("addresses", announced(("docker0", "172.17.0.1", 16))).with_laptop("routes", routes)
    assert both.root_ids() == []


# -- which server a program asks ------------------------------------------------------------------------------------------


def asking(machines: Machines, host: str, routes: RoutingTable) -> list[tuple[str, Severity, str]]:
    """Return the findings about a program of the laptop that asks the server at `host`."""
    environment = {"ROS_DISCOVERY_SERVER": f"{host}:11811"}
    changed = machines.with_laptop("ros-processes", lambda found: (replace(found[0], pid=4242, environment=environment),))
    return [
        (each.id, each.severity, each.cause)
        for each in changed.with_laptop("routes", routes).root_findings()
        if each.id == "process-wrong-server"
    ]


def test_program_for_another_examined_robot_is_right(healthy: Machines) -> None:
    both = {"10.42.0.1": ("10.42.0.1 dev lan0 src 10.42.0.2",), "10.77.0.1": ("10.77.0.1 dev lan1 src 10.77.0.2",)}
    routes = RoutingTable((CABLE, ACCESS_POINT, RouteEntry("10.77.0.0/24", "lan1")), to_robot=both)
    assert asking(healthy, "10.77.0.1", routes) == []
    assert asking(healthy, "10.77.0.9", routes)


@pytest.mark.parametrize("host", ["10.42.0.1", "192.168.42.1"])
def test_gateway_that_leads_to_the_robot_is_a_route(healthy: Machines, host: str) -> None:
    lines = {"10.42.0.1": ("10.42.0.1 via 192.168.1.1 dev wlp2s0 src 192.168.1.20",)}
    assert asking(healthy, host, RoutingTable((DEFAULT,), to_robot=lines)) == []


def test_only_a_refused_address_has_no_route(healthy: Machines) -> None:
    def found(*main: RouteEntry, **to_robot: str) -> list[tuple[Severity, bool]]:
        routes = RoutingTable((CABLE, *main), to_robot={host.replace("_", "."): (line,) for host, line in to_robot.items()})
        answers = asking(healthy, "192.168.42.1", routes)
        return [(severity, "the laptop has no route to it" in cause) for _, severity, cause in answers]

    assert found() == [(Severity.PROBLEM, True)]
    assert found(DEFAULT) == [(Severity.WARNING, False)]
    assert found(DEFAULT, **{"192_168_42_1": UNREACHABLE}) == [(Severity.PROBLEM, True)]
    assert found(ACCESS_POINT) == []


@pytest.mark.parametrize(
    "text", ["@@ routes\n\n@@ wireless\n", "@@ routes\n\n@@ wireless\n@@ robot 10.42.0.1 10.42.0.1\nsh: 5: ip: not found\n"]
)
def test_machine_without_ip_has_no_known_routes(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected JSON of ip\(8\).*ip: not found"):
        ROUTES.parse(Output(0, f"@@ routes\n\n@@ wireless\n{text}", "sh: 3: ip: not found"))
    assert ROUTES.parse(Output(0, "@@ routes\n[ ]\n@@ wireless\n")).main == ()
