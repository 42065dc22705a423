"""Pytest fixtures for tests on a simulated computer. `tests/conftest.py` loads them for all tests.

`host`         one robot for the whole test session, booted at its first use (1 to 3 s) and healthy when the test begins. For
               tests that only inspect it, or undo what they change.
`fresh_host`   the same robot, for a test that may do anything to it: faults, files, reboots, power cuts. After the test it is
               reset: new disk, correct clock, all cables plugged in, freshly booted.
`boot_host`    a function that boots further hosts for one test: boot_host(robots=3), boot_host(vendor_robot=True). Its
               arguments are those of `Host.start`.

Mark the tests with `@pytest.mark.host`. They are skipped with one line that names what this machine lacks; under
LUPIN_CI_STRICT=1 that is a failure.

    host.robot.eth0, host.robot.wlan0      its addresses, 10.42.0.1 and 192.168.42.1; host.robots[n] if there are several
    with host.on_laptop(): ...             this thread uses the laptop's network: connect sockets and paramiko inside the block.
                                           Sockets and threads (such as a paramiko transport's) from the block stay on it
    host.run(["lupin", "doctor"])          a program on the laptop: 10.42.0.2 and 192.168.42.2, its own processes and
                                           /dev/shm, this machine's files. Pass env=... with its own HOME and without ROS_*
    host.popen([...])                      the same in the background: signals and kill() reach the program itself
    host.ssh("systemctl is-active ssh")    OpenSSH from the laptop, as mirte
    host.ssh_command("ls")                 ... its command line
    host.key, host.known_hosts             mirte's private key; the robots' host keys. User mirte, password mirte_mirte, sudo
    host.robot.run_as_root("cat", "/etc/shadow")   a command on the robot as root, without SSH: .status .stdout .stderr
    host.robot.inject_fault("cable-cut", link="eth0")      a fault that `lupin sim host fault` lists; .undo_fault()
                                                   undoes it, `with host.robot.with_fault(...)` does both
    host.robot.power_cut(), power_on(), power_off(), factory_reset(), wait_ready()
    host.serve_ntp()                       starts the laptop's NTP server; host.serve_ntp("off") stops it
    host.robot.state["clock_offset_s"]     its entry in `lupin sim host status --json`
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from lupin_runtime.ports import DISCOVERY_PORT
from lupin_sim.host.host import Host, HostError, HostUnavailable, Robot

MAX_STACK_STARTS = 3  # of the vendor's stack, until its discovery server listens
# Waits up to 20 s, which a start takes on a busy machine. Reads /proc instead of using SSH: a login changes the robot's state.
WAIT_FOR_SERVER_PORT = (
    f"for _ in $(seq 100); do grep -q ':{DISCOVERY_PORT:04X} ' /proc/1/net/udp && exit; sleep 0.2; done; exit 1"
)


class SharedHost:
    """The one host of a test session. `dirty` marks that a test may have left it in any state."""

    def __init__(self) -> None:
        self._host: Host | None = None
        self.dirty = False

    def get_healthy(self) -> Host:
        """Return the host; boot it at the first use, and reset it if it is dirty."""
        if self._host is None:
            self._host = boot_or_skip()
        elif self.dirty:
            self._host.robot.factory_reset()
        self.dirty = False
        return self._host

    def end(self) -> None:
        """Stop the host."""
        if self._host is not None:
            self._host.end()


def boot_or_skip(**options: Any) -> Host:
    """Boot a host, or skip the test with one line that names what this machine lacks.

    With `vendor_robot` it waits for the discovery servers: on a busy machine the vendor's start script can lose its race at
    boot, and it never checks whether the server came up.
    """
    try:
        host = Host.start(**options)
    except HostUnavailable as missing:
        pytest.skip(str(missing))
    if options.get("vendor_robot"):
        try:
            for robot in host.robots:
                wait_for_discovery_server(robot)
        except BaseException:
            host.end()
            raise
    return host


def wait_for_discovery_server(robot: Robot) -> None:
    """Wait until a robot's discovery server listens; restart the vendor's stack if it does not. Raises HostError."""
    for attempt in range(MAX_STACK_STARTS):
        if attempt:
            robot.run_as_root("systemctl", "restart", "mirte-ros", timeout_s=60.0)
        if robot.run_as_root("sh", "-c", WAIT_FOR_SERVER_PORT, timeout_s=60.0).status == 0:
            return
    status = robot.run_as_root("systemctl", "status", "--lines=20", "--no-pager", "mirte-ros").stdout
    raise HostError(f"no discovery server on robot {robot.number} after {MAX_STACK_STARTS} starts of its stack\n{status}")


@pytest.fixture(scope="session")
def shared_host() -> Iterator[SharedHost]:
    """The holder of the session's host, which `host` and `fresh_host` share."""
    shared = SharedHost()
    yield shared
    shared.end()


@pytest.fixture
def host(shared_host: SharedHost) -> Host:
    """Return a host with a healthy robot, for tests that leave it as it is."""
    return shared_host.get_healthy()


@pytest.fixture
def fresh_host(shared_host: SharedHost) -> Iterator[Host]:
    """Yield a host with a healthy robot, for tests that may do anything to it; it is reset afterwards."""
    yield shared_host.get_healthy()
    shared_host.dirty = True  # set after the test, since `host` in the same test is this host


@pytest.fixture
def boot_host() -> Iterator[Callable[..., Host]]:
    """Yield a function that boots further hosts for one test; stop these afterwards."""
    hosts: list[Host] = []

    def boot(**options: Any) -> Host:
        hosts.append(boot_or_skip(**options))
        return hosts[-1]

    yield boot
    for each in hosts:
        each.end()
