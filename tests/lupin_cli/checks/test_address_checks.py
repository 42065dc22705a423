"""Checks of WiFi, addresses and interfaces. Captured facts: each fault is the only root cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Severity
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.sockets import Sockets
from tests.support.changed_facts import without_access_point
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines


@pytest.mark.parametrize("kind", ["no-route", "timeout", "refused", "silent", "name", "lost", "host-key-changed"])
def test_unreachable_robot_is_explained_by_failure_kind(healthy: Machines, kind: str) -> None:
    (finding,) = healthy.unreachable(kind).root_findings()
    assert finding.id == "robot-unreachable"
    assert f"({kind})" in finding.cause
    assert finding.evidence[0] == f"mirte@10.42.0.1: {kind}"


def test_login_shell_that_runs_nothing_is_the_robots(healthy: Machines) -> None:
    (finding,) = healthy.unreachable("login-shell").root_findings()
    assert (finding.id, finding.layer, finding.where) == ("robot-unreachable", "login", "robot")


def test_roamed_wifi_explains_unreachable_robot(healthy: Machines) -> None:
    faulty = healthy.unreachable("no-route").with_laptop("routes", "roamed").with_laptop("addresses", "roamed")
    faulty = replace(faulty, link=replace(present(faulty.link), address="192.168.42.1"))
    (finding,) = faulty.with_laptop("network-manager", "roamed-to-eduroam").root_findings()
    assert finding.id == "wifi-roamed"
    assert finding.fix.command == "nmcli connection up Mirte-247264"
    assert any("eduroam" in line for line in finding.evidence)


def test_unplugged_cable_explains_unreachable_robot(healthy: Machines) -> None:
    faulty = healthy.unreachable("no-route").with_laptop("routes", "cable-out").with_laptop("addresses", "cable-out")
    (finding,) = faulty.root_findings()
    assert finding.id == "no-carrier"
    assert (finding.layer, finding.where) == ("carrier", "link")
    assert "lan0 NO-CARRIER 10.42.0.2/24" in finding.evidence


def test_equal_wifi_priorities_warn_only_over_radio(healthy: Machines) -> None:
    def by_radio(routes: Any) -> Any:
        return replace(routes, wireless=frozenset({"wifi0"}))

    faulty = healthy.with_laptop("network-manager", "equal-priorities")
    assert faulty.root_ids() == []  # the cable carries the link
    at_the_access_point = replace(faulty, link=replace(present(faulty.link), address="192.168.42.1"))
    (finding,) = at_the_access_point.with_laptop("routes", by_radio).root_findings()
    assert (finding.id, finding.severity) == ("wifi-may-roam", Severity.WARNING)
    assert "connection.autoconnect-priority 100" in finding.fix.command
    pinned = at_the_access_point.with_laptop("network-manager", "on-the-access-point")
    assert pinned.with_laptop("routes", by_radio).root_ids() == []


def test_multihomed_robot_with_unroutable_address_is_named(healthy: Machines) -> None:
    (finding,) = healthy.with_laptop("routes", without_access_point).root_findings()
    assert finding.id == "robot-multi-homed"
    assert "192.168.42.1" in finding.cause
    assert "robot: wlan0 UP 192.168.42.1/24" in finding.evidence
    assert finding.fix.playbook == "single-home"
    assert not finding.fix.safe


def test_default_route_does_not_lead_to_the_access_point(healthy: Machines) -> None:
    def internet(routes: Any) -> Any:
        default = replace(routes.main[0], destination="default", gateway="10.128.0.1", device="wifi1")
        return replace(without_access_point(routes), main=(*without_access_point(routes).main, default))

    assert healthy.with_laptop("routes", internet).root_ids() == ["robot-multi-homed"]


def test_multihomed_robot_with_whitelist_is_healthy(healthy: Machines) -> None:
    faulty = healthy.with_laptop("routes", without_access_point)
    whitelisted = faulty.with_robot("dds-profiles", lambda ps: tuple(replace(p, whitelist=("10.42.0.1",)) for p in ps))
    assert whitelisted.root_ids() == []


def test_address_without_carrier_is_not_announced(healthy: Machines) -> None:
    def ap_down(addresses: Addresses) -> Addresses:
        return Addresses(tuple(replace(a, carrier=False) if a.interface == "wlan0" else a for a in addresses.entries))

    faulty = healthy.with_laptop("routes", without_access_point)
    assert faulty.with_robot("addresses", ap_down).root_ids() == []


def test_process_older_than_address_is_named_on_both_machines(healthy: Machines) -> None:
    def unaware(address: str) -> Callable[[Sockets], Sockets]:
        return lambda sockets: Sockets(tuple(each for each in sockets.entries if each.address != address))

    (robot,) = healthy.with_robot("sockets", unaware("10.42.0.1")).root_findings()
    assert (robot.id, robot.where) == ("process-older-than-interface", "robot")
    assert "telemetrix" in robot.cause
    (laptop,) = healthy.with_laptop("sockets", unaware("10.42.0.2")).root_findings()
    assert (laptop.id, laptop.where) == ("process-older-than-interface", "laptop")
    assert "slam_toolbox" in laptop.cause


def test_newer_address_off_the_link_is_ignored(healthy: Machines) -> None:
    newer = Address("docker0", "172.17.0.1", 16, "global", up=True, carrier=False)
    assert healthy.with_robot("addresses", lambda a: Addresses((*a.entries, newer))).root_ids() == []
