"""Checks of Fast DDS profiles. Captured facts: each fault is the only root cause."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Finding, Severity
from lupin_cli.facts.dds_profiles import Server, parse_profile
from lupin_cli.facts.graph import Graph, Graphs
from tests.support.changed_facts import own_profile

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines

WRONG_PREFIX = "44.53.01.5f.45.50.52.4f.53.49.4d.41"


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        ({"default": False}, "profile-not-default"),
        ({"protocol": "CLIENT"}, "profile-not-super-client"),
        ({"protocol": "SERVER"}, "profile-not-super-client"),
        ({"servers": (Server(WRONG_PREFIX, "10.42.0.1", 11811),)}, "profile-wrong-prefix"),
        ({"servers": (Server("44.53.00.5f.45.50.52.4f.53.49.4d.41", "192.168.42.1", 11811),)}, "profile-wrong-address"),
        ({"servers": ()}, "profile-without-server"),
        ({"error": "the file is missing or not readable"}, "profile-unreadable"),
    ],
)
def test_each_profile_fault_is_named(healthy: Machines, fault: dict[str, Any], name: str) -> None:
    (finding,) = healthy.with_laptop("dds-profiles", own_profile(**fault)).root_findings()
    assert finding.id == name
    assert "fastdds_super_client.xml" in finding.cause
    assert finding.fix.command == "lupin dds setup 10.42.0.1"


@pytest.mark.parametrize(
    ("fault", "word"),
    [
        ({"whitelist": ("192.168.42.7",)}, "interfaceWhiteList allows only 192.168.42.7"),
        ({"builtin_transports": False}, "no transport of its own"),
        ({"builtin_transports": False, "own_transports": ("SHM",)}, "its own transports are SHM"),
    ],
)
def test_profile_that_excludes_the_link_is_named(healthy: Machines, fault: dict[str, Any], word: str) -> None:
    (finding,) = healthy.with_laptop("dds-profiles", own_profile(**fault)).root_findings()
    assert (finding.id, finding.layer, finding.where) == ("profile-excludes-link", "profile", "laptop")
    assert word in finding.cause
    for harmless in ({"whitelist": ("10.42.0.2",)}, {"whitelist": ("lan0",)}):
        assert healthy.with_laptop("dds-profiles", own_profile(**harmless)).root_ids() == []
    udp: dict[str, Any] = {"builtin_transports": False, "own_transports": ("UDPv4",)}
    assert healthy.with_laptop("dds-profiles", own_profile(**udp)).root_ids() == []


def test_transports_of_a_profile_are_read() -> None:
    text = """<profiles><transport_descriptors><transport_descriptor><transport_id>mine</transport_id><type>UDPv4</type>
    <interfaceWhiteList><address>10.42.0.9</address></interfaceWhiteList></transport_descriptor></transport_descriptors>
    <participant profile_name="p" is_default_profile="true"><rtps><userTransports><transport_id>mine</transport_id>
    </userTransports><useBuiltinTransports>false</useBuiltinTransports></rtps></participant></profiles>"""
    profile = parse_profile("/p.xml", text)
    assert (profile.own_transports, profile.builtin_transports, profile.whitelist) == (("UDPv4",), False, ("10.42.0.9",))


def test_profile_is_compared_with_the_shells_server(healthy: Machines) -> None:
    def stale(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        home = "/home/operator/.config/lupin/fastdds_super_client.xml"
        environment = {"ROS_DISCOVERY_SERVER": "192.168.42.1:11811", "FASTRTPS_DEFAULT_PROFILES_FILE": home}
        return (*processes, replace(processes[0], pid=99, environment=environment))

    faulty = healthy.with_laptop("ros-processes", stale)
    assert "profile-wrong-address" not in faulty.root_ids()
    elsewhere = own_profile(servers=(Server("44.53.00.5f.45.50.52.4f.53.49.4d.41", "192.168.42.1", 11811),))
    found = faulty.with_laptop("dds-profiles", elsewhere).root_findings()
    (finding,) = (finding for finding in found if finding.id == "profile-wrong-address")
    assert finding.fix.command == "lupin dds setup 10.42.0.1"


@pytest.mark.parametrize("machine", ["laptop", "robot"])
def test_process_older_than_its_profile_is_named(healthy: Machines, machine: str) -> None:
    with_fact = healthy.with_laptop if machine == "laptop" else healthy.with_robot

    def aged(seconds: float | None) -> Machines:
        changed = with_fact("dds-profiles", lambda ps: tuple(replace(each, age_s=seconds) for each in ps))
        return changed.with_laptop("graph", Graphs((Graph("robot", "robot", ()),)))

    def found(seconds: float | None) -> list[Finding]:
        return [finding for finding in aged(seconds).root_findings() if finding.id == "profile-changed"]

    (finding,) = found(0.5)
    assert (finding.where, finding.layer, finding.severity) == (machine, "profile", Severity.WARNING)
    assert "started before" in finding.cause and any("s old" in line for line in finding.evidence)
    assert not found(1e9) and not found(None) and not found(-5.0)
    assert (
        "profile-changed" not in with_fact("dds-profiles", lambda ps: tuple(replace(each, age_s=0.5) for each in ps)).root_ids()
    )  # nothing is missing


def test_unused_faulty_profile_is_ignored(healthy: Machines) -> None:
    stray = healthy.with_laptop("dds-profiles", lambda ps: (*ps, replace(ps[0], path="/old.xml", default=False)))
    assert stray.root_ids() == []
