"""What a machine is asked for beyond its facts: journals, units, network, DDS, system. Each script changes nothing.

A script exits with ABSENT where there is nothing of the kind. Journals give their first lines as well as their last: a race at
the cold boot is told by the first.
"""

from __future__ import annotations

import shlex

from lupin_cli.facts.sections import PRELUDE
from lupin_cli.facts.units import VENDOR
from lupin_cli.onboard import ROOT
from lupin_cli.quick_dataclass import dataclass

ABSENT = 44
LAST_LINES, FIRST_LINES = 4000, 400
HEAD_BYTES, TAIL_BYTES = 200_000, 700_000  # together below what a batch carries of one script
FILE_BYTES = 60_000  # of each of several files in one
TIMEOUT_S = 15.0
ROBOT, LAPTOP = "robot", "laptop"


@dataclass(frozen=True)
class Source:
    """One file of a machine's folder in the archive. `root`: worth asking sudo for, where it is a robot."""

    path: str
    what: str
    script: str
    root: bool = False
    machines: tuple[str, ...] = (ROBOT, LAPTOP)
    timeout_s: float = TIMEOUT_S


def journal(path: str, what: str, *selection: str, machines: tuple[str, ...] = (ROBOT, LAPTOP)) -> Source:
    """The journal's lines of some units: of this boot, or since `$since`."""
    words = shlex.join(selection)
    script = f"""command -v journalctl >/dev/null 2>&1 || exit {ABSENT}
j() {{ journalctl --no-pager -q -o short-iso-precise ${{since:--b}} "$@" {words}; }}
echo '@@ last'; j -n {LAST_LINES} | tail -c {TAIL_BYTES}; echo
echo '@@ first'; j | head -n {FIRST_LINES} | head -c {HEAD_BYTES}
"""
    return Source(path, what, script, root=True, machines=machines)


def command(path: str, what: str, text: str, *, root: bool = False, machines: tuple[str, ...] = (ROBOT, LAPTOP)) -> Source:
    """What some commands print, each behind its own line; the last lines of it, where it is long."""
    lines = [f"echo {shlex.quote(f'$ {line}')}; {line} 2>&1" for line in text.splitlines()]
    return Source(path, what, f"{{ {'; '.join(lines)}; }} | tail -c {TAIL_BYTES}\n", root, machines)


def files(
    path: str,
    what: str,
    *patterns: str,
    root: bool = False,
    machines: tuple[str, ...] = (ROBOT, LAPTOP),
    limit: int = FILE_BYTES,
) -> Source:
    """Files, one behind the other; ABSENT where there is none of them. One that can't be read says so in its place."""
    script = f"""found=
for f in {" ".join(patterns)}; do
  [ -f "$f" ] || continue
  found=yes; echo "@@ file $f"
  head -c {limit} "$f" 2>&1; echo
  [ "$(wc -c <"$f")" -le {limit} ] || echo "[... the rest of $f left out here ...]"
done
[ -n "$found" ] || exit {ABSENT}
"""
    return Source(path, what, f"set +f\n{script}", root, machines)


_ROBOT_ONLY = (ROBOT,)
_CLOCK = ("chrony", "chronyd", "systemd-timesyncd", "lupin-clock-sync")
_NETWORK = ("NetworkManager", "wpa_supplicant", "systemd-networkd", "hostapd", "dnsmasq", "mirte-ap", "mirte-wifi-watchdog")

SOURCES: tuple[Source, ...] = (
    journal("journal/mirte-ros.log", "the vendor's ROS stack", "-u", VENDOR, machines=_ROBOT_ONLY),
    journal("journal/lupin.log", "Lupin's units", "-u", "lupin-*"),
    journal("journal/clock.log", "chrony and the clock", *(word for unit in _CLOCK for word in ("-u", unit))),
    journal("journal/network.log", "NetworkManager, WiFi, access point", *(word for unit in _NETWORK for word in ("-u", unit))),
    journal("journal/kernel.log", "the kernel", "-k"),
    journal("journal/ssh.log", "who logged in", "-u", "ssh", "-u", "sshd", machines=_ROBOT_ONLY),
    journal("journal/warnings.log", "warnings and errors of everything", "-p", "warning", machines=_ROBOT_ONLY),
    Source(
        "journal/boots.txt", "the boots that the journal knows",
        f"command -v journalctl >/dev/null 2>&1 || exit {ABSENT}\njournalctl -q --list-boots | tail -n 30\n", root=True,
    ),
    Source(
        "system/dmesg.txt", "the kernel's ring",
        f"dmesg >/dev/null || exit 1\ndmesg | tail -n 2000 | tail -c {TAIL_BYTES}\n", root=True,
    ),
    command(
        "system/state.txt", "load, memory, disks, devices",
        "uname -a\ncat /etc/os-release\nuptime\ndate -u\nfree -m\ndf -h\ndf -i\ncat /proc/meminfo\nls -l /dev/shm\nlsusb",
    ),
    command(
        "system/processes.txt", "every process of the robot", "ps -eo pid,ppid,user,stat,lstart,pcpu,rss,args",
        machines=_ROBOT_ONLY,
    ),
    command(
        "units/state.txt", "services, timers, and what failed",
        "systemctl list-units --all --type=service,timer --no-legend --no-pager --plain\n"
        "systemctl list-units --failed --no-legend --no-pager --plain\nsystemctl list-jobs --no-pager\n"
        "systemd-analyze critical-chain --no-pager mirte-ros.service",
        machines=_ROBOT_ONLY,
    ),
    command(
        "units/installed.txt", "the units of Lupin and of the vendor as systemd reads them",
        "systemctl cat --no-pager 'lupin-*' 'mirte-*' chrony.service", machines=_ROBOT_ONLY,
    ),
    command(
        "network/state.txt", "addresses, routes, neighbours, sockets",
        "ip -details address\nip rule\nip route show table all\nip neigh\nss -tuanp\niw dev\niw reg get\n"
        "cat /etc/resolv.conf /etc/hosts",
        root=True,
    ),
    files(
        "network/settings.txt", "saved connections, access point, chrony",
        "/etc/NetworkManager/system-connections/*", "/etc/NetworkManager/NetworkManager.conf", "/etc/NetworkManager/conf.d/*",
        "/etc/netplan/*", "/etc/systemd/network/*", "/etc/hostapd/*.conf", "/etc/wpa_supplicant/*.conf", "/etc/dnsmasq.conf",
        "/etc/dnsmasq.d/*", "/etc/chrony/*.conf", "/etc/chrony/*/*.conf", "/etc/chrony.conf", root=True, machines=_ROBOT_ONLY,
    ),
    files(
        "dds/files.txt", "profiles, exports and start files that choose the graph",
        *(f'"${{XDG_CONFIG_HOME:-$HOME/.config}}"/lupin/{name}' for name in ("fastdds_super_client.xml", "ros-env.sh")),
        '"$HOME"/mirte_ws/install/*.xml', '"$HOME"/.mirte_settings.sh', '"$HOME"/fastdds*.xml',
    ),
    files("ros/launch.log", "the last launch, as ROS logged it", '"$HOME"/.ros/log/latest/launch.log', machines=_ROBOT_ONLY),
    command(
        "release/state.txt", "which release runs, and how the folders lie",
        f"cat {ROOT}/current/release.json\nreadlink {ROOT}/current {ROOT}/previous\n"
        f"ls -la {ROOT} {ROOT}/releases {ROOT}/incoming",
        machines=_ROBOT_ONLY,
    ),
    files(
        "release/manifest.txt", "what the release consists of", f"{ROOT}/current/manifest",
        machines=_ROBOT_ONLY, limit=TAIL_BYTES,
    ),
)  # fmt: skip


def of_machine(machine: str) -> tuple[Source, ...]:
    """The sources of "robot" or "laptop"."""
    return tuple(source for source in SOURCES if machine in source.machines)


def script_of(source: Source, since_s: float | None) -> str:
    """The script as it is run."""
    since = "" if since_s is None else f"since=--since=-{max(1, round(since_s))}s\n"
    return PRELUDE + since + source.script
