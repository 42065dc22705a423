"""Each fault has the effect that an operator would see, and no effect after it is undone."""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass, field
from typing import Any

import pytest

from lupin_sim.host import Host, HostError
from lupin_sim.host.faults import FAULTS
from tests.support.waiting import wait_until

pytestmark = pytest.mark.host

LOST_AFTER_S = 1.0


def connect(host: Host, port: int = 22, timeout_s: float = 1.0, address: str = "10.42.0.1") -> str:
    """Return the first bytes of a TCP connection from the laptop, or the name of its error."""
    with host.on_laptop():
        try:
            with socket.create_connection((address, port), timeout=timeout_s) as connection:
                connection.settimeout(timeout_s)
                return connection.recv(4).decode()
        except TimeoutError:
            return "timeout"
        except OSError as error:
            return type(error).__name__ if error.errno is None else f"errno {error.errno}"


def round_trip_ms(host: Host) -> float:
    """Return the shortest time of four attempts to connect to sshd; infinite if each failed or took LOST_AFTER_S."""
    best = float("inf")
    for _ in range(4):
        with host.on_laptop():
            start = time.monotonic()
            try:
                socket.create_connection(("10.42.0.1", 22), timeout=LOST_AFTER_S).close()
            except OSError:
                continue
            best = min(best, (time.monotonic() - start) * 1e3)
    return best


@dataclass(frozen=True)
class Effect:
    """A fault and its effect: what a shell command, run on the robot as root, prints with the fault and without it."""

    fault: str
    command: str
    broken: str
    healthy: str
    settings: dict[str, Any] = field(default_factory=dict)


COUNT_SEGMENTS = "find /dev/shm -name 'fastrtps_????????????????_el' | wc -l"
PING = "ping -c1 -W1 {} >/dev/null && echo passes; true"
SERVER_ADDRESS = "ps -eo args= | grep -o '[f]ast-discovery-server -i 0 -l [0-9.]*' | cut -d' ' -f5"
SERVER_PORT_BOUND = "ss -lnu | grep -c ':11811 '; true"
EFFECTS = (
    Effect("cable-cut", "cat /sys/class/net/eth0/carrier", "0", "1"),
    Effect(
        "switch-dead",
        "cat /sys/class/net/eth0/carrier; ping -c1 -W1 10.42.0.2 >/dev/null && echo passes; true",
        "1",
        "1 passes",
    ),
    Effect("narrow-link", PING.format("10.42.0.2"), "", "passes", {"rate_mbit_s": 0.0005}),
    Effect("lossy-link", PING.format("10.42.0.2"), "", "passes", {"loss": 1.0}),
    Effect("wifi-roam", PING.format("192.168.42.2"), "", "passes"),
    Effect(
        "host-key-changed", "cat /etc/ssh/ssh_host_*.pub | cmp - /etc/keys-before >/dev/null && echo same; true", "", "same"
    ),
    Effect("sudo-password", "runuser -u mirte -- sudo -n id -u 2>&1", "sudo: a password is required", "0"),
    Effect(
        "sudo-refused", "id -nG mirte | grep -c sudo; runuser -u mirte -- sudo -n id -u 2>&1 | grep -c '^0'; true", "0 0", "1 1"
    ),
    Effect("program-missing", "command -v chronyd; true", "", "/usr/sbin/chronyd", {"program": "chronyd"}),
    Effect("disk-full", "head -c 3000000 /dev/zero 2>/dev/null > /home/mirte/big && echo fits; rm /home/mirte/big", "", "fits"),
    Effect("disk-read-only", "touch /home/mirte/x /etc/x 2>/dev/null && echo writable; true", "", "writable"),
    Effect("port-taken", "ss -lnt | grep -c ':8091 '; true", "1", "0"),
    Effect("chrony-stopped", "systemctl is-active chrony; true", "inactive", "active"),
    Effect("server-not-started", f"{SERVER_PORT_BOUND}; systemctl is-active mirte-ros", "0 active", "1 active"),
    Effect(
        "server-not-started", f"{SERVER_PORT_BOUND}; systemctl is-active mirte-ros", "0 active", "1 active", {"cause": "path"}
    ),
    Effect("server-killed", f"{SERVER_PORT_BOUND}; systemctl is-active mirte-ros", "0 active", "1 active"),
    Effect("server-pinned", SERVER_ADDRESS, "192.168.42.1", "0.0.0.0"),
    Effect("server-stopped", "ps -o stat= -C fast-discovery- | cut -c1", "T", "S"),
    Effect("server-port-taken", "ss -lnup | grep ':11811 ' | grep -c python3; true", "1", "0"),
    Effect("stock-makestep", "grep -c '^makestep' /etc/chrony/chrony.conf; true", "1", "0"),
    Effect("camera-held", "find /proc/[0-9]*/fd -lname /dev/video0 2>/dev/null | wc -l", "1", "0"),
    Effect("home-locked", "runuser -u mirte -- sh -c 'test -w /home/mirte && echo may; true'", "", "may"),
    Effect("not-in-group", "id -nG mirte | grep -cw sudo; true", "0", "1", {"group": "sudo"}),
    Effect("unit", "systemctl is-active mirte-jupyter; true", "inactive", "active", {"unit": "mirte-jupyter"}),
    Effect(
        "unit",
        "systemctl is-enabled mirte-jupyter; true",
        "disabled",
        "enabled",
        {"unit": "mirte-jupyter", "state": "disabled"},
    ),
    Effect(
        "unit", "systemctl is-enabled mirte-jupyter; true", "masked", "enabled", {"unit": "mirte-jupyter", "state": "masked"}
    ),
    Effect(
        "unit", "systemctl is-active mirte-jupyter; true", "failed", "active", {"unit": "mirte-jupyter", "state": "failing"}
    ),
    Effect("dds-off", f"{SERVER_PORT_BOUND}; systemctl is-active mirte-ros", "0 active", "1 active"),
    Effect("zombies", "ps -eo stat=,args= | grep -c '^T.*zombi[e]'; true", "2", "0"),
    Effect("shm-orphans", COUNT_SEGMENTS, "3", "1"),
    Effect("shm-foreign", COUNT_SEGMENTS.replace("-name", "-user root -name"), "1", "0"),
    Effect("shm-full", "head -c 3000000 /dev/zero 2>/dev/null > /dev/shm/big && echo fits; rm /dev/shm/big", "", "fits"),
    Effect("oneshot-failed", "systemctl is-failed lupin-auto-home; true", "failed", "inactive"),
)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: "-".join([effect.fault, *map(str, effect.settings.values())]))
def test_fault_has_its_effect_until_it_is_undone(host: Host, effect: Effect) -> None:
    def output() -> str:
        return " ".join(host.robot.run_as_root("sh", "-c", effect.command).stdout.split())

    host.robot.run_as_root("sh", "-c", "test -e /etc/keys-before || cat /etc/ssh/ssh_host_*.pub > /etc/keys-before")
    if effect.fault == "stock-makestep":
        host.robot.undo_fault(effect.fault)  # a new robot has this fault, since the distribution ships it
    wait_until(lambda: output() == effect.healthy, f"{effect.healthy!r} before {effect.fault}, not {output()!r}")
    host.robot.inject_fault(effect.fault, **effect.settings)
    try:
        assert effect.fault in host.robot.state["faults"]
        wait_until(lambda: output() == effect.broken, f"{effect.broken!r} with {effect.fault}, not {output()!r}")
    finally:
        host.robot.undo_fault(effect.fault, **effect.settings)
    wait_until(lambda: output() == effect.healthy, f"{effect.healthy!r} after {effect.fault}, not {output()!r}")
    assert host.robot.state["faults"] == []


def test_cable_cut_on_both_links_is_undone_one_by_one(host: Host) -> None:
    def carriers() -> list[str]:
        return host.robot.run_as_root("cat", "/sys/class/net/eth0/carrier", "/sys/class/net/wlan0/carrier").stdout.split()

    for link in ("eth0", "wlan0"):
        host.robot.inject_fault("cable-cut", link=link)
    assert carriers() == ["0", "0"]
    host.robot.undo_fault("cable-cut", link="eth0")
    assert carriers() == ["1", "0"]
    host.robot.inject_fault("cable-cut", link="eth0")
    host.robot.undo_fault("cable-cut")
    assert carriers() == ["1", "1"]


def test_cable_cut_removes_the_laptops_carrier_not_its_route(host: Host) -> None:
    with host.robot.with_fault("cable-cut"):
        assert "NO-CARRIER" in host.run(["ip", "link", "show", "lan0"]).stdout
        assert "10.42.0.0/24" in host.run(["ip", "route"]).stdout
        assert host.run(host.ssh_command("true", link="wlan0")).returncode == 0
    host.robot.wait_ready()


def test_dead_switch_makes_connections_hang(host: Host) -> None:
    with host.robot.with_fault("switch-dead"):
        assert connect(host) in ("timeout", "errno 113")  # the latter once the kernel has given up on the neighbor
        assert "NO-CARRIER" not in host.run(["ip", "link", "show", "lan0"]).stdout
    host.robot.wait_ready()


def test_hung_sshd_accepts_and_sends_no_banner(host: Host) -> None:
    with host.robot.with_fault("sshd-hung"):
        assert connect(host) == "timeout"
    assert connect(host, timeout_s=5.0) == "SSH-"


def test_stopped_sshd_refuses_connections(host: Host) -> None:
    with host.robot.with_fault("sshd-down"):
        assert connect(host) == "ConnectionRefusedError" or connect(host) == "errno 111"
    host.robot.wait_ready()


def test_frozen_robot_accepts_and_answers_after_it_is_resumed(host: Host) -> None:
    with host.robot.with_fault("frozen"):
        assert connect(host) == "timeout"
    assert host.ssh("true").returncode == 0


def test_slow_link_delays_both_directions_after_power_cut_too(fresh_host: Host) -> None:
    robot = fresh_host.robot
    assert round_trip_ms(fresh_host) < 50.0
    robot.inject_fault("slow-link", delay_ms=60.0, jitter_ms=2.0)
    assert 110.0 < round_trip_ms(fresh_host) < 500.0
    robot.power_cut()
    robot.power_on()
    robot.wait_ready()
    assert round_trip_ms(fresh_host) > 110.0
    robot.undo_fault("slow-link")
    assert round_trip_ms(fresh_host) < 50.0


LISTENER = (
    "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('', 7400)); s.settimeout(8)\n"
    "s.setsockopt(0, socket.IP_ADD_MEMBERSHIP, socket.inet_aton('239.255.0.1') + socket.inet_aton('10.42.0.1'))\n"
    "print('listening', flush=True)\n"
    "print(*(s.recv(100).decode() for _ in range({count})))"
)


def test_no_multicast_still_passes_unicast(host: Host) -> None:
    received = {}
    for broken in (False, True):
        if broken:
            host.robot.inject_fault("no-multicast")
        code = LISTENER.format(count=1 if broken else 2)
        with host.popen(host.ssh_command(f'python3 -c "{code}"'), text=True, stdout=-1, stdin=-3) as listener:
            assert listener.stdout is not None
            assert listener.stdout.readline() == "listening\n"
            with host.on_laptop(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("10.42.0.2"))
                sender.sendto(b"group", ("239.255.0.1", 7400))
                sender.sendto(b"one", ("10.42.0.1", 7400))
            received[broken] = listener.communicate(timeout=60)[0].split()
    host.robot.undo_fault("no-multicast")
    assert received == {False: ["group", "one"], True: ["one"]}


COUNT_DATAGRAMS = (
    "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('', {port})); s.settimeout(2)\n"
    "print('listening', flush=True)\nreceived = []\n"
    "try:\n  while True: received.append(s.recv(999))\n"
    "except TimeoutError: print(len(received), len(set(received)))"
)
SENT = 200


def count_datagrams(host: Host, port: int = 7413) -> tuple[int, int]:
    """How many of SENT datagrams over the cable a port of the robot receives, and how many different ones.

    The listener is started over the other link, which has no fault.
    """
    with host.popen(host.ssh_command("python3 -", link="wlan0"), text=True, stdout=-1, stdin=-1) as listener:
        assert listener.stdout is not None and listener.stdin is not None
        listener.stdin.write(COUNT_DATAGRAMS.format(port=port))
        listener.stdin.close()
        assert listener.stdout.readline() == "listening\n"
        with host.on_laptop(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for number in range(SENT):
                sender.sendto(f"datagram {number}".encode(), ("10.42.0.1", port))
                time.sleep(0.001)  # faster, the emulator's socket could overflow
        total, different = listener.stdout.readline().split()
        listener.wait(60)
    return int(total), int(different)


def test_corrupting_link_loses_and_duplicating_link_doubles(host: Host) -> None:
    assert count_datagrams(host) == (SENT, SENT)
    with host.robot.with_fault("corrupting-link", fraction=0.5):
        total, different = count_datagrams(host)
        assert 0 < total == different < SENT  # the receiver's checksum finds every flipped bit
    with host.robot.with_fault("duplicating-link", fraction=1.0):
        assert count_datagrams(host) == (2 * SENT, SENT)


def test_filtered_link_drops_its_ports_in_one_direction(host: Host) -> None:
    ports = {"first_port": 7400, "last_port": 7413}
    with host.robot.with_fault("filtered-link", direction="to-robot", **ports):
        assert count_datagrams(host)[0] == 0
        assert count_datagrams(host, 7414)[0] == SENT
    with host.robot.with_fault("filtered-link", direction="from-robot", **ports):
        assert count_datagrams(host)[0] == SENT
    with pytest.raises(HostError, match="expected the direction to-robot or from-robot"):
        host.robot.inject_fault("filtered-link", direction="sideways")


def test_dual_homed_laptop_has_no_route_and_sends_no_dds_data(host: Host) -> None:
    code = "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.sendto(b'x', ('10.42.0.1', 7413))"
    listen = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('', 7413)); s.settimeout(1.5)\n"
        "print('listening', flush=True)\nprint(s.recv(9))"
    )
    with host.robot.with_fault("dual-homed"):
        assert "192.168.42.0" not in host.run(["ip", "route"]).stdout
        assert "192.168.42.1" in host.ssh("ip -4 -br address").stdout
        with host.popen(host.ssh_command(f'python3 -c "{listen}"'), text=True, stdout=-1, stderr=-3) as listener:
            assert listener.stdout is not None
            listener.stdout.readline()
            host.run(["python3", "-c", code])
            assert listener.communicate(timeout=60)[0] == ""
    assert host.ssh("true").returncode == 0


def test_lost_boot_race_leaves_the_real_message_in_the_journal(host: Host) -> None:
    messages = {"port": "wasn't able to allocate the specified listening port", "path": "fast-discovery-server tool not found"}
    for cause, message in messages.items():
        with host.robot.with_fault("server-not-started", cause=cause):
            assert message in host.ssh("sudo journalctl -u mirte-ros -o cat -n 20 --no-pager").stdout


def test_orphaned_segments_have_locks_that_no_process_holds(host: Host) -> None:
    test_lock = (
        "import fcntl, glob\n"
        "for path in glob.glob('/dev/shm/fastrtps_*_el'):\n"
        "    try: fcntl.flock(open(path), fcntl.LOCK_EX | fcntl.LOCK_NB); print('free')\n"
        "    except BlockingIOError: print('held')"
    )
    with host.robot.with_fault("shm-orphans", count=1):
        locks = host.robot.run_as_root("python3", "-c", test_lock).stdout.split()
    assert "free" in locks
    assert "held" in locks  # the discovery server's own


def test_late_interface_has_no_sockets_of_the_server(host: Host) -> None:
    with host.robot.with_fault("interface-late"):
        wait_until(lambda: "192.168.42.1" in host.ssh("ip -4 -br address").stdout, "the access point's address")
        sockets = host.robot.run_as_root("ss", "-lnup").stdout
        assert [line for line in sockets.splitlines() if "10.42.0.1:" in line and "fast-discovery" in line]
        assert not [line for line in sockets.splitlines() if "192.168.42.1:" in line and "fast-discovery" in line]


def test_faults_on_one_link_combine_and_are_undone_singly(host: Host) -> None:
    with host.robot.with_fault("slow-link", delay_ms=40.0, jitter_ms=0.0):
        with host.robot.with_fault("no-multicast"):
            assert 75.0 < round_trip_ms(host) < 500.0
        assert 75.0 < round_trip_ms(host) < 500.0
    assert round_trip_ms(host) < 50.0


def test_power_cut_and_reboot_are_faults_too(fresh_host: Host) -> None:
    robot = fresh_host.robot
    boots = robot.state["boots"]
    with robot.with_fault("power-cut"):
        assert not robot.state["running"]
        assert connect(fresh_host) in ("timeout", "errno 113")
    robot.wait_ready()
    robot.inject_fault("reboot")
    wait_until(lambda: robot.state["boots"] == boots + 2, "the boot after the reboot")
    robot.wait_ready()


def test_unknown_fault_or_setting_is_refused_with_the_known_ones(host: Host) -> None:
    with pytest.raises(HostError, match="unknown fault 'nosuch'; expected one of: cable-cut"):
        host.robot.inject_fault("nosuch")
    with pytest.raises(HostError, match="cable-cut has no setting color; it has: link"):
        host.robot.inject_fault("cable-cut", color="red")
    with pytest.raises(HostError, match="reboot is a one-time fault: there is nothing to undo"):
        host.robot.undo_fault("reboot")


def test_factory_reset_undoes_all_faults(fresh_host: Host) -> None:
    robot = fresh_host.robot
    for name in ("cable-cut", "wifi-roam", "frozen", "no-multicast", "clock-wrong"):
        robot.inject_fault(name, **({"link": "wlan0"} if name == "cable-cut" else {}))
    robot.factory_reset()
    assert robot.state["faults"] == []
    assert abs(robot.state["clock_offset_s"]) < 0.1
    assert fresh_host.run(fresh_host.ssh_command("true", link="wlan0")).returncode == 0


def test_all_faults_have_a_summary_and_all_but_reboot_an_undo() -> None:
    assert [name for name, fault in FAULTS.items() if fault.undo is None] == ["reboot"]
    assert all(fault.summary for fault in FAULTS.values())
