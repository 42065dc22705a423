"""Checks of ports that another program uses, and of faults two at a time. Captured facts: each fault is the only root cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.facts.sockets import Sockets
from tests.support.changed_facts import changed, own_profile, with_socket, without_access_point, without_port

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines


@pytest.mark.parametrize(
    ("protocol", "port", "stranger", "owner"),
    [
        ("tcp", 8090, "node vite", "/usr/bin/python -m lupin_runtime.stack.process console.json"),
        ("tcp", 9090, "python rosbridge_websocket", "/opt/lupin/bin/lupin up"),
        (
            "tcp",
            8090,
            "/home/me/lupin/.venv/bin/python -m http.server 8090",
            "/home/me/robot/.venv/bin/python -P -m lupin_cli.app up",
        ),
        ("tcp", 9090, "python3 -m http.server --directory /srv/lupin", "/usr/bin/python3 /opt/x/bin/lupin console"),
        ("udp", 123, "ntpd", "/usr/sbin/chronyd -F 1"),
        ("udp", 123, "ntpd -c /etc/chronyd", "/usr/sbin/chronyd"),
    ],
)
def test_port_is_named_unless_its_owner_holds_it(
    healthy: Machines, protocol: str, port: int, stranger: str, owner: str
) -> None:
    def held(command: str, pid: int = 4242) -> list[str]:
        name = command.split()[0].rsplit("/", 1)[-1][:15]  # the kernel truncates it
        socket = with_socket(protocol=protocol, address="0.0.0.0", port=port, process=name, pid=pid, command=command)
        return healthy.with_laptop("sockets", socket).root_ids()

    assert held(stranger) == [f"port-{port}-taken"]
    assert held(owner) == []


def test_port_with_invisible_owner_is_ignored(healthy: Machines) -> None:
    unseen = with_socket(protocol="udp", address="0.0.0.0", port=123)
    assert healthy.with_laptop("sockets", unseen).root_ids() == []


# -- two at a time --------------------------------------------------------------------------------------------------------
def with_other_middleware(machines: Any) -> Any:
    """Add a process to the robot that uses another middleware."""

    def more(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        libraries = frozenset({"librmw_cyclonedds_cpp.so", "librcl.so"})
        return (*processes, replace(processes[1], pid=500, libraries=libraries))

    return machines.with_robot("ros-processes", more)


def with_orphans(machines: Any) -> Any:
    """Add shared memory of two killed participants."""

    def more(files: tuple[Any, ...]) -> tuple[Any, ...]:
        names = ("fastrtps_00aa", "fastrtps_00aa_el", "fastrtps_00bb", "fastrtps_00bb_el")
        return (*files, *(replace(files[0], name=name, held=False, holder=0) for name in names))

    return machines.with_robot("shared-memory", more)


FAULTS: dict[str, Callable[[Any], Any]] = {
    "discovery-server-missing": lambda machines: machines.with_robot("sockets", without_port(11811)),
    "robot-multi-homed": lambda machines: machines.with_laptop("routes", without_access_point),
    "zombie-process": lambda machines: machines.with_robot("ros-processes", changed(1, state="T")),
    "shared-memory-orphans": with_orphans,
    "rmw-mismatch": with_other_middleware,
    "profile-not-default": lambda machines: machines.with_laptop("dds-profiles", own_profile(default=False)),
    "source-order": lambda machines: machines.with_laptop("shell", "wiped"),
    "port-9090-taken": lambda machines: machines.with_laptop(
        "sockets", with_socket(protocol="tcp", address="0.0.0.0", port=9090, process="node", pid=9, command="node x")
    ),
    "process-older-than-interface": lambda machines: machines.with_laptop(
        "sockets", lambda s: Sockets(tuple(each for each in s.entries if each.address != "10.42.0.2"))
    ),
}


@pytest.mark.parametrize("pair", [(a, b) for a in FAULTS for b in FAULTS if a < b], ids="+".join)
def test_two_faults_are_named_and_no_third(healthy: Machines, pair: tuple[str, str]) -> None:
    faulty = healthy
    for name in pair:
        faulty = FAULTS[name](faulty)
    assert sorted(faulty.root_ids()) == sorted(pair)
