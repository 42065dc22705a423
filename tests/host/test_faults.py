"""Every fault is really made, is seen where an operator would see it, and is gone when it is taken back."""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass, field
from typing import Any

import pytest

from lupin_sim.host import Host, HostError
from lupin_sim.host.faults import FAULTS
from lupin_sim.host.fixtures import until

pytestmark = pytest.mark.host


def connect(host: Host, port: int = 22, timeout_s: float = 1.0, address: str = "10.42.0.1") -> str:
    """How a TCP connection from the laptop goes: its first bytes, or the name of what went wrong."""
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
    """The best of some connections to sshd; infinite where none came about within a second each."""
    best = float("inf")
    for _ in range(4):
        with host.on_laptop():
            began = time.monotonic()
            try:
                socket.create_connection(("10.42.0.1", 22), timeout=1.0).close()
            except OSError:
                continue
            best = min(best, (time.monotonic() - began) * 1e3)
    return best


@dataclass(frozen=True)
class Seen:
    """A fault and how it shows: what a shell command in the robot, run as root, prints while it stands and without it."""

    fault: str
    command: str
    broken: str
    healthy: str
    settings: dict[str, Any] = field(default_factory=dict)


SHM = "find /dev/shm -name 'fastrtps_????????????????_el' | wc -l"
REACHES = "ping -c1 -W1 {} >/dev/null && echo passes; true"
SERVER_AT = "ps -eo args= | grep -o '[f]ast-discovery-server -i 0 -l [0-9.]*' | cut -d' ' -f5"
BOUND = "ss -lnu | grep -c ':11811 '; true"
ON_ROBOT = (
    Seen("cable-cut", "cat /sys/class/net/eth0/carrier", "0", "1"),
    Seen(
        "switch-dead",
        "cat /sys/class/net/eth0/carrier; ping -c1 -W1 10.42.0.2 >/dev/null && echo passes; true",
        "1",
        "1 passes",
    ),
    Seen("lossy-link", REACHES.format("10.42.0.2"), "", "passes", {"loss": 1.0}),
    Seen("wifi-roam", REACHES.format("192.168.42.2"), "", "passes"),
    Seen("host-key-changed", "cat /etc/ssh/ssh_host_*.pub | cmp - /etc/keys-before >/dev/null && echo same; true", "", "same"),
    Seen("sudo-password", "runuser -u mirte -- sudo -n id -u 2>&1", "sudo: a password is required", "0"),
    Seen(
        "sudo-refused", "id -nG mirte | grep -c sudo; runuser -u mirte -- sudo -n id -u 2>&1 | grep -c '^0'; true", "0 0", "1 1"
    ),
    Seen("program-missing", "command -v chronyd; true", "", "/usr/sbin/chronyd", {"program": "chronyd"}),
    Seen("disk-full", "head -c 3000000 /dev/zero 2>/dev/null > /home/mirte/big && echo fits; rm /home/mirte/big", "", "fits"),
    Seen("disk-read-only", "touch /home/mirte/x /etc/x 2>/dev/null && echo writable; true", "", "writable"),
    Seen("port-taken", "ss -lnt | grep -c ':8091 '; true", "1", "0"),
    Seen("chrony-stopped", "systemctl is-active chrony; true", "inactive", "active"),
    Seen("server-not-started", f"{BOUND}; systemctl is-active mirte-ros", "0 active", "1 active"),
    Seen("server-not-started", f"{BOUND}; systemctl is-active mirte-ros", "0 active", "1 active", {"cause": "path"}),
    Seen("server-killed", f"{BOUND}; systemctl is-active mirte-ros", "0 active", "1 active"),
    Seen("server-pinned", SERVER_AT, "192.168.42.1", "0.0.0.0"),
    Seen("server-stopped", "ps -o stat= -C fast-discovery- | cut -c1", "T", "S"),
    Seen("server-port-taken", "ss -lnup | grep ':11811 ' | grep -c python3; true", "1", "0"),
    Seen("stock-makestep", "grep -c '^makestep' /etc/chrony/chrony.conf; true", "1", "0"),
    Seen("camera-held", "find /proc/[0-9]*/fd -lname /dev/video0 2>/dev/null | wc -l", "1", "0"),
    Seen("home-locked", "runuser -u mirte -- sh -c 'test -w /home/mirte && echo may; true'", "", "may"),
    Seen("not-in-group", "id -nG mirte | grep -cw sudo; true", "0", "1", {"group": "sudo"}),
    Seen("unit", "systemctl is-active mirte-jupyter; true", "inactive", "active", {"unit": "mirte-jupyter"}),
    Seen(
        "unit",
        "systemctl is-enabled mirte-jupyter; true",
        "disabled",
        "enabled",
        {"unit": "mirte-jupyter", "state": "disabled"},
    ),
    Seen("unit", "systemctl is-enabled mirte-jupyter; true", "masked", "enabled", {"unit": "mirte-jupyter", "state": "masked"}),
    Seen("unit", "systemctl is-active mirte-jupyter; true", "failed", "active", {"unit": "mirte-jupyter", "state": "failing"}),
    Seen("dds-off", f"{BOUND}; systemctl is-active mirte-ros", "0 active", "1 active"),
    Seen("zombies", "ps -eo stat=,args= | grep -c '^T.*zombi[e]'; true", "2", "0"),
    Seen("shm-orphans", SHM, "3", "1"),
    Seen("shm-foreign", SHM.replace("-name", "-user root -name"), "1", "0"),
    Seen("shm-full", "head -c 3000000 /dev/zero 2>/dev/null > /dev/shm/big && echo fits; rm /dev/shm/big", "", "fits"),
    Seen("oneshot-failed", "systemctl is-failed lupin-auto-home; true", "failed", "inactive"),
)


@pytest.mark.parametrize("seen", ON_ROBOT, ids=lambda seen: "-".join([seen.fault, *map(str, seen.settings.values())]))
def test_a_fault_is_seen_on_the_robot_and_can_be_taken_back(host: Host, seen: Seen) -> None:
    def shown() -> str:
        return " ".join(host.robot.inside("sh", "-c", seen.command).stdout.split())

    host.robot.inside("sh", "-c", "test -e /etc/keys-before || cat /etc/ssh/ssh_host_*.pub > /etc/keys-before")
    if seen.fault == "stock-makestep":
        host.robot.mend(seen.fault)  # a new robot has it, as the distribution does
    until(lambda: shown() == seen.healthy, f"{seen.healthy!r} before {seen.fault}, not {shown()!r}")
    host.robot.fault(seen.fault, **seen.settings)
    try:
        assert seen.fault in host.robot.state["faults"]
        until(lambda: shown() == seen.broken, f"{seen.broken!r} while {seen.fault} stands, not {shown()!r}")
    finally:
        host.robot.mend(seen.fault, **seen.settings)
    until(lambda: shown() == seen.healthy, f"{seen.healthy!r} after {seen.fault}, not {shown()!r}")
    assert host.robot.state["faults"] == []


def test_both_cables_are_cut_and_each_is_mended_by_itself(host: Host) -> None:
    def carriers() -> list[str]:
        return host.robot.inside("cat", "/sys/class/net/eth0/carrier", "/sys/class/net/wlan0/carrier").stdout.split()

    for link in ("eth0", "wlan0"):
        host.robot.fault("cable-cut", link=link)
    assert carriers() == ["0", "0"]
    host.robot.mend("cable-cut", link="eth0")
    assert carriers() == ["1", "0"]
    host.robot.fault("cable-cut", link="eth0")
    host.robot.mend("cable-cut")
    assert carriers() == ["1", "1"]


def test_a_cut_cable_takes_the_laptops_carrier_and_leaves_its_route(host: Host) -> None:
    with host.robot.broken("cable-cut"):
        assert "NO-CARRIER" in host.run(["ip", "link", "show", "lan0"]).stdout
        assert "10.42.0.0/24" in host.run(["ip", "route"]).stdout
        assert host.run(host.ssh_command("true", link="wlan0")).returncode == 0
    host.robot.wait_ready()


def test_a_dead_switch_lets_connections_hang(host: Host) -> None:
    with host.robot.broken("switch-dead"):
        assert connect(host) in ("timeout", "errno 113")  # hangs, until the kernel gives the neighbour up
        assert "NO-CARRIER" not in host.run(["ip", "link", "show", "lan0"]).stdout
    host.robot.wait_ready()


def test_a_hung_sshd_accepts_and_says_nothing(host: Host) -> None:
    with host.robot.broken("sshd-hung"):
        assert connect(host) == "timeout"
    assert connect(host, timeout_s=5.0) == "SSH-"


def test_a_stopped_sshd_refuses(host: Host) -> None:
    with host.robot.broken("sshd-down"):
        assert connect(host) == "ConnectionRefusedError" or connect(host) == "errno 111"
    host.robot.wait_ready()


def test_a_frozen_robot_accepts_and_says_nothing_and_goes_on_afterwards(host: Host) -> None:
    with host.robot.broken("frozen"):
        assert connect(host) == "timeout"
    assert host.ssh("true").returncode == 0


def test_a_slow_link_adds_its_latency_both_ways_and_survives_a_reboot_of_the_robot(fresh_host: Host) -> None:
    robot = fresh_host.robot
    assert round_trip_ms(fresh_host) < 50.0
    robot.fault("slow-link", delay_ms=60.0, jitter_ms=2.0)
    assert 110.0 < round_trip_ms(fresh_host) < 500.0
    robot.power_cut()
    robot.power_on()
    robot.wait_ready()
    assert round_trip_ms(fresh_host) > 110.0
    robot.mend("slow-link")
    assert round_trip_ms(fresh_host) < 50.0


LISTENER = (
    "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('', 7400)); s.settimeout(8)\n"
    "s.setsockopt(0, socket.IP_ADD_MEMBERSHIP, socket.inet_aton('239.255.0.1') + socket.inet_aton('10.42.0.1'))\n"
    "print('listening', flush=True)\n"
    "print(*(s.recv(100).decode() for _ in range({count})))"
)


def test_without_multicast_unicast_still_passes(host: Host) -> None:
    heard = {}
    for broken in (False, True):
        if broken:
            host.robot.fault("no-multicast")
        code = LISTENER.format(count=1 if broken else 2)
        with host.popen(host.ssh_command(f'python3 -c "{code}"'), text=True, stdout=-1, stdin=-3) as listener:
            assert listener.stdout is not None
            assert listener.stdout.readline() == "listening\n"
            with host.on_laptop(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("10.42.0.2"))
                sender.sendto(b"group", ("239.255.0.1", 7400))
                sender.sendto(b"one", ("10.42.0.1", 7400))
            heard[broken] = listener.communicate(timeout=20)[0].split()
    host.robot.mend("no-multicast")
    assert heard == {False: ["group", "one"], True: ["one"]}


def test_dual_homed_the_laptop_has_lost_the_route_to_an_address_that_the_robot_keeps(host: Host) -> None:
    code = "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.sendto(b'x', ('10.42.0.1', 7413))"
    listen = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.bind(('', 7413)); s.settimeout(1.5)\n"
        "print('listening', flush=True)\nprint(s.recv(9))"
    )
    with host.robot.broken("dual-homed"):
        assert "192.168.42.0" not in host.run(["ip", "route"]).stdout
        assert "192.168.42.1" in host.ssh("ip -4 -br address").stdout
        with host.popen(host.ssh_command(f'python3 -c "{listen}"'), text=True, stdout=-1, stderr=-3) as listener:
            assert listener.stdout is not None
            listener.stdout.readline()
            host.run(["python3", "-c", code])
            assert listener.communicate(timeout=20)[0] == ""
    assert host.ssh("true").returncode == 0


def test_a_lost_race_leaves_the_real_servers_words_in_the_journal(host: Host) -> None:
    words = {"port": "wasn't able to allocate the specified listening port", "path": "fast-discovery-server tool not found"}
    for cause, said in words.items():
        with host.robot.broken("server-not-started", cause=cause):
            assert said in host.ssh("sudo journalctl -u mirte-ros -o cat -n 20 --no-pager").stdout


def test_an_orphan_is_the_segments_of_a_participant_whose_locks_nobody_holds(host: Host) -> None:
    test_lock = (
        "import fcntl, glob\n"
        "for path in glob.glob('/dev/shm/fastrtps_*_el'):\n"
        "    try: fcntl.flock(open(path), fcntl.LOCK_EX | fcntl.LOCK_NB); print('free')\n"
        "    except BlockingIOError: print('held')"
    )
    with host.robot.broken("shm-orphans", count=1):
        locks = host.robot.inside("python3", "-c", test_lock).stdout.split()
    assert "free" in locks
    assert "held" in locks  # the discovery server's own


def test_an_interface_can_come_up_after_the_processes_that_need_it(host: Host) -> None:
    with host.robot.broken("interface-late"):
        until(lambda: "192.168.42.1" in host.ssh("ip -4 -br address").stdout, "the access point's address")
        sockets = host.robot.inside("ss", "-lnup").stdout
        assert [line for line in sockets.splitlines() if "10.42.0.1:" in line and "fast-discovery" in line]
        assert not [line for line in sockets.splitlines() if "192.168.42.1:" in line and "fast-discovery" in line]


def test_faults_at_the_same_link_add_up_and_go_one_by_one(host: Host) -> None:
    with host.robot.broken("slow-link", delay_ms=40.0, jitter_ms=0.0):
        with host.robot.broken("no-multicast"):
            assert 75.0 < round_trip_ms(host) < 500.0
        assert 75.0 < round_trip_ms(host) < 500.0
    assert round_trip_ms(host) < 50.0


def test_the_plug_is_a_fault_too_and_a_reboot_an_event(fresh_host: Host) -> None:
    robot = fresh_host.robot
    boots = robot.state["boots"]
    with robot.broken("power-cut"):
        assert not robot.state["running"]
        assert connect(fresh_host) in ("timeout", "errno 113")
    robot.wait_ready()
    robot.fault("reboot")
    until(lambda: robot.state["boots"] == boots + 2, "the boot after the reboot")
    robot.wait_ready()


def test_an_unknown_fault_or_setting_is_refused_by_name(host: Host) -> None:
    with pytest.raises(HostError, match="there is no fault 'nosuch'; there are: cable-cut"):
        host.robot.fault("nosuch")
    with pytest.raises(HostError, match="cable-cut knows no colour; it takes link"):
        host.robot.fault("cable-cut", colour="red")
    with pytest.raises(HostError, match="reboot is over once it happened"):
        host.robot.mend("reboot")


def test_a_renewed_robot_has_none_of_its_faults(fresh_host: Host) -> None:
    robot = fresh_host.robot
    for name in ("cable-cut", "wifi-roam", "frozen", "no-multicast", "clock-wrong"):
        robot.fault(name, **({"link": "wlan0"} if name == "cable-cut" else {}))
    robot.renew()
    assert robot.state["faults"] == []
    assert abs(robot.state["clock_offset_s"]) < 0.1
    assert fresh_host.run(fresh_host.ssh_command("true", link="wlan0")).returncode == 0


def test_every_fault_has_a_summary_and_can_be_taken_back_unless_it_is_an_event() -> None:
    assert [name for name, fault in FAULTS.items() if fault.undo is None] == ["reboot"]
    assert all(fault.summary for fault in FAULTS.values())
