"""Pytest fixtures: a robot's computer that really boots. `tests/conftest.py` loads them, so every test can ask for them.

`host`         one robot for the whole test session, booted at its first use (1 to 3 s). For tests that only look: what they
               change, they change back. It is healthy when the test begins.
`fresh_host`   the same robot for one test that may do anything to it: faults, files, reboots, power cuts. Whoever comes next
               finds it with a new disk, a right clock, all cables plugged in, and freshly booted.
`boot_host`    a function that boots further hosts for one test: boot_host(robots=3), boot_host(vendor_robot=True). Its
               arguments are those of `Host.start`.

Mark the tests with `@pytest.mark.host`. They are skipped with one line that names what this machine lacks; under
LUPIN_CI_STRICT=1 that is a failure.

    host.robot.eth0, host.robot.wlan0      its addresses, 10.42.0.1 and 192.168.42.1; host.robots[n] where there are several
    with host.on_laptop(): ...             this thread is on the laptop's network: connect sockets and paramiko in here. What
                                           is started in here, a paramiko transport's thread say, stays there, as sockets do
    host.run(["lupin", "doctor"])          a program on the laptop: 10.42.0.2 and 192.168.42.2, its own processes and
                                           /dev/shm, this machine's files. Give it a HOME of its own (env=...), and an
                                           environment without ROS_*
    host.popen([...])                      the same, running: signals and kill() reach the program itself
    host.ssh("systemctl is-active ssh")    OpenSSH from the laptop, as mirte
    host.ssh_command("ls")                 ... its command line
    host.key, host.known_hosts             mirte's private key; the robots' host keys. User mirte, password mirte_mirte, sudo
    host.robot.inside("cat", "/etc/shadow")        a command in there as root, without a network: .status .stdout .stderr
    host.robot.fault("cable-cut", link="eth0")     break something, by the names that `lupin sim host fault` lists; .mend()
                                                   takes it back, `with host.robot.broken(...)` does both
    host.robot.power_cut(), power_on(), power_off(), renew(), wait_ready()
    host.serve_ntp()                       the laptop's clock server; host.serve_ntp("off") ends it
    host.robot.state["clock_offset_s"]     how it stands
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from lupin_sim.host.host import Host, HostError, HostUnavailable, Robot

STARTS = 3  # of a stack, until its discovery server must have come up
# 20 s, which a start on a busy machine takes. Seen without a login, whose end would be one more event on the robot.
UNTIL_IT_LISTENS = f"for _ in $(seq 100); do grep -q ':{11811:04X} ' /proc/1/net/udp && exit; sleep 0.2; done; exit 1"


class Lent:
    """The session's host, and whether somebody may have left it in any state."""

    def __init__(self) -> None:
        self._host: Host | None = None
        self.spoilt = False

    def healthy(self) -> Host:
        """The host, booted at the first use and renewed after a test that spoilt it."""
        if self._host is None:
            self._host = start()
        elif self.spoilt:
            self._host.robot.renew()
        self.spoilt = False
        return self._host

    def end(self) -> None:
        """Switch it off for good."""
        if self._host is not None:
            self._host.end()


def until(condition: Callable[[], object], what: str, limit_s: float = 20.0) -> None:
    """Wait until it holds. Fails the test after `limit_s`, with what it waited for."""
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, f"not within {limit_s:g} s: {what}"
        time.sleep(0.05)


def start(**options: Any) -> Host:
    """Boot a host, or skip the test with one line that says what this machine lacks for it.

    With `vendor_robot` its discovery serves: on a busy machine a boot loses the vendor's race for real, and his script never
    looks again.
    """
    try:
        host = Host.start(**options)
    except HostUnavailable as missing:
        pytest.skip(str(missing))
    if options.get("vendor_robot"):
        try:
            for robot in host.robots:
                until_it_serves(robot)
        except BaseException:
            host.end()
            raise
    return host


def until_it_serves(robot: Robot) -> None:
    """Wait for the discovery server of a stack that starts; one that came up without is started anew. Raises HostError."""
    for attempt in range(STARTS):
        if attempt:
            robot.inside("systemctl", "restart", "mirte-ros", timeout_s=60.0)
        if robot.inside("sh", "-c", UNTIL_IT_LISTENS, timeout_s=60.0).status == 0:
            return
    seen = robot.inside("systemctl", "status", "--lines=20", "--no-pager", "mirte-ros").stdout
    raise HostError(f"no discovery server on robot {robot.number} after {STARTS} starts of its stack\n{seen}")


@pytest.fixture(scope="session")
def lent_host() -> Iterator[Lent]:
    """Holds the one host of a session for `host` and `fresh_host`."""
    lent = Lent()
    yield lent
    lent.end()


@pytest.fixture
def host(lent_host: Lent) -> Host:
    """A healthy robot to look at."""
    return lent_host.healthy()


@pytest.fixture
def fresh_host(lent_host: Lent) -> Iterator[Host]:
    """A healthy robot to do anything to."""
    yield lent_host.healthy()
    lent_host.spoilt = True  # also where the test asked for `host` as well, which is this one


@pytest.fixture
def boot_host() -> Iterator[Callable[..., Host]]:
    """Boots further hosts for one test."""
    hosts: list[Host] = []

    def boot(**options: Any) -> Host:
        hosts.append(start(**options))
        return hosts[-1]

    yield boot
    for each in hosts:
        each.end()
