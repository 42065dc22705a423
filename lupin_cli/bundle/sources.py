"""Sources: what a bundle reads from a machine beyond its facts, and how the output of each becomes an item or an omission.

Each source is a shell script that changes nothing: journals, units, network, DDS, system state. Scripts run in one batch; those
that sudo refuses run again as the user, who may be able to read some of it. A script exits with NOT_FOUND if the machine has
nothing of the kind. A journal's first lines are read as well as its last: a race at cold boot shows in the first.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from lupin_cli.bundle.items import ABSENT, UNREACHABLE, UNREADABLE, BundleItem, Omission, encode, join_ends
from lupin_cli.connection.base import Output, Script, Target, TargetError
from lupin_cli.facts.sections import PRELUDE
from lupin_cli.facts.units import VENDOR
from lupin_cli.release.paths import ROOT

NOT_FOUND = 44  # exit status of a script
LAST_LINES, FIRST_LINES = 4000, 400
HEAD_BYTES, TAIL_BYTES = 200_000, 700_000  # their sum is below what a batch returns for one script
FILE_BYTES = 60_000  # limit of each file if a source reads several
TIMEOUT_S = 15.0
ROBOT, LAPTOP = "robot", "laptop"


@dataclass(frozen=True)
class ItemSource:
    """One file of a machine's folder in the archive. With `root`, a robot's sudo is tried first."""

    path: str
    description: str
    script: str
    root: bool = False
    machines: tuple[str, ...] = (ROBOT, LAPTOP)
    timeout_s: float = TIMEOUT_S


def journal(path: str, description: str, *selection: str, machines: tuple[str, ...] = (ROBOT, LAPTOP)) -> ItemSource:
    """The system journal's lines for `selection`: of this boot, or since `$since`."""
    words = shlex.join(selection)
    script = f"""command -v journalctl >/dev/null 2>&1 || exit {NOT_FOUND}
j() {{ journalctl --no-pager -q -o short-iso-precise ${{since:--b}} "$@" {words}; }}
echo '@@ last'; j -n {LAST_LINES} | tail -c {TAIL_BYTES}; echo
echo '@@ first'; j | head -n {FIRST_LINES} | head -c {HEAD_BYTES}
"""
    return ItemSource(path, description, script, root=True, machines=machines)


def command(
    path: str, description: str, text: str, *, root: bool = False, machines: tuple[str, ...] = (ROBOT, LAPTOP)
) -> ItemSource:
    """The output of some commands, each after the command itself; the last TAIL_BYTES of it."""
    lines = [f"echo {shlex.quote(f'$ {line}')}; {line} 2>&1" for line in text.splitlines()]
    return ItemSource(path, description, f"{{ {'; '.join(lines)}; }} | tail -c {TAIL_BYTES}\n", root, machines)


def files(
    path: str,
    description: str,
    *patterns: str,
    root: bool = False,
    machines: tuple[str, ...] = (ROBOT, LAPTOP),
    limit: int = FILE_BYTES,
) -> ItemSource:
    """The concatenated files that match `patterns`. An unreadable file leaves its error message in its place."""
    script = f"""found=
for f in {" ".join(patterns)}; do
  [ -f "$f" ] || continue
  found=yes; echo "@@ file $f"
  head -c {limit} "$f" 2>&1; echo
  [ "$(wc -c <"$f")" -le {limit} ] || echo "[... the rest of $f left out here ...]"
done
[ -n "$found" ] || exit {NOT_FOUND}
"""
    return ItemSource(path, description, f"set +f\n{script}", root, machines)


_ROBOT_ONLY = (ROBOT,)
_CLOCK = ("chrony", "chronyd", "systemd-timesyncd", "lupin-clock-sync")
_NETWORK = ("NetworkManager", "wpa_supplicant", "systemd-networkd", "hostapd", "dnsmasq", "mirte-ap", "mirte-wifi-watchdog")

SOURCES: tuple[ItemSource, ...] = (
    journal("journal/mirte-ros.log", "the vendor's ROS stack", "-u", VENDOR, machines=_ROBOT_ONLY),
    journal("journal/lupin.log", "Lupin's units", "-u", "lupin-*"),
    journal("journal/clock.log", "chrony and the clock", *(word for unit in _CLOCK for word in ("-u", unit))),
    journal("journal/network.log", "NetworkManager, WiFi, access point", *(word for unit in _NETWORK for word in ("-u", unit))),
    journal("journal/kernel.log", "the kernel", "-k"),
    journal("journal/ssh.log", "logins", "-u", "ssh", "-u", "sshd", machines=_ROBOT_ONLY),
    journal("journal/warnings.log", "warnings and errors of all programs", "-p", "warning", machines=_ROBOT_ONLY),
    ItemSource(
        "journal/boots.txt", "the boots that the journal has",
        f"command -v journalctl >/dev/null 2>&1 || exit {NOT_FOUND}\njournalctl -q --list-boots | tail -n 30\n", root=True,
    ),
    ItemSource(
        "system/dmesg.txt", "the kernel's ring buffer",
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
        "units/state.txt", "services, timers, and failed units",
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
        "network/state.txt", "addresses, routes, neighbors, sockets",
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
        "dds/files.txt", "profiles, exports and startup files that select the graph",
        *(f'"${{XDG_CONFIG_HOME:-$HOME/.config}}"/lupin/{name}' for name in ("fastdds_super_client.xml", "ros-env.sh")),
        '"$HOME"/mirte_ws/install/*.xml', '"$HOME"/.mirte_settings.sh', '"$HOME"/fastdds*.xml',
    ),
    files("ros/launch.log", "the last launch, as ROS logged it", '"$HOME"/.ros/log/latest/launch.log', machines=_ROBOT_ONLY),
    command(
        "release/state.txt", "the installed releases and their folders",
        f"cat {ROOT}/current/release.json\nreadlink {ROOT}/current {ROOT}/previous\n"
        f"ls -la {ROOT} {ROOT}/releases {ROOT}/incoming",
        machines=_ROBOT_ONLY,
    ),
    files(
        "release/manifest.txt", "the files of the release", f"{ROOT}/current/manifest",
        machines=_ROBOT_ONLY, limit=TAIL_BYTES,
    ),
)  # fmt: skip


def sources_of(machine: str) -> tuple[ItemSource, ...]:
    """Return the sources of "robot" or "laptop"."""
    return tuple(source for source in SOURCES if machine in source.machines)


def script_of(source: ItemSource, max_age_s: float | None) -> str:
    """Return the complete script of a source; system journals go back `max_age_s` seconds, or to the boot."""
    since = "" if max_age_s is None else f"since=--since=-{max(1, round(max_age_s))}s\n"
    return PRELUDE + since + source.script


# -- reading the sources of a machine

_BATCH_SLACK_S = 3.0
_SUDO_REFUSED = "root refused:"  # start of stderr, see Target.batch
_FORBIDDEN = re.compile(r"permission|not permitted|denied", re.I)
_JOURNAL = re.compile(r"@@ last\n(?P<last>.*?)\n?@@ first\n(?P<first>.*)\Z", re.S)


def read_sources(
    target: Target, sources: Sequence[ItemSource], folder: str, *, max_age_s: float | None = None, sudo: bool = True
) -> Iterable[BundleItem | Omission]:
    """Run all sources on `target` and yield their items below `folder`.

    A target that cannot be reached gives an omission for each source instead of an error.
    """
    try:
        outputs = _run(target, sources, max_age_s, root=sudo)
        refused = [source for source in sources if outputs[source.path].stderr.startswith(_SUDO_REFUSED)]
        reasons = {source.path: outputs[source.path].stderr for source in refused}
        if refused:
            outputs |= _run(target, refused, max_age_s, root=False)
    except TargetError as error:
        for source in sources:
            yield Omission(f"{folder}/{source.path}", UNREACHABLE, str(error))
        return
    for source in sources:
        yield parse_source(source, outputs[source.path], folder, target.user, reasons.get(source.path, ""))


def _run(target: Target, sources: Sequence[ItemSource], max_age_s: float | None, *, root: bool) -> dict[str, Output]:
    scripts = [Script(each.path, script_of(each, max_age_s), each.timeout_s, root and each.root) for each in sources]
    missing = Output(None, "", "the machine gave no answer")
    outputs = target.batch(scripts, timeout_s=max(each.timeout_s for each in sources) + _BATCH_SLACK_S)
    return {each.path: outputs.get(each.path, missing) for each in sources}


def parse_source(source: ItemSource, output: Output, folder: str, user: str, refused: str = "") -> BundleItem | Omission:
    """Turn a source's output into an item or an omission. `refused` is the reason if sudo refused. Pure."""
    path = f"{folder}/{source.path}"
    if output.status == NOT_FOUND:
        return Omission(path, ABSENT, "this machine has none")
    text, remark = _text(output)
    if not text.strip():
        error = (output.stderr.strip().splitlines() or [""])[-1]
        if output.status != 0:
            return Omission(path, UNREADABLE, error or f"it exited with status {output.status}")
        if refused or _FORBIDDEN.search(output.stderr):
            return Omission(path, UNREADABLE, "; ".join(filter(None, (f"{user} has no permission to read it", error, refused))))
        return Omission(path, ABSENT, error or "it is empty")
    if output.status is None or output.truncated:
        timeout_remark = "it did not finish in time"
        remark = f"{remark}; {timeout_remark}" if remark else output.stderr.strip() or timeout_remark
    as_user = f"read as {user} ({refused})" if refused else ""
    return BundleItem(path, source.description, encode(text), "; ".join(filter(None, (remark, as_user))))


def _text(output: Output) -> tuple[str, str]:
    """Return the text that the script printed, and what is missing from it. A journal's first lines are put before its last."""
    journal = _JOURNAL.match(output.stdout)
    if journal is None:
        if len(encode(output.stdout)) < TAIL_BYTES:
            return output.stdout, ""
        return output.stdout.partition("\n")[2], "its first lines are left out"
    first, last = journal["first"], journal["last"]
    if len(encode(last)) >= TAIL_BYTES:
        last = last.partition("\n")[2]  # its first line is incomplete
    if len(encode(first)) >= HEAD_BYTES:
        first = first[: first.rfind("\n") + 1]
    head, tail = first.splitlines(), last.splitlines()
    if not head or not tail or tail[0] in head or tail[0] <= head[0]:
        # The tail overlaps the head, or one of them is all there is.
        return "\n".join(_merge(head, tail)) + "\n" * bool(tail or head), ""
    joined = join_ends(encode(first.rstrip("\n") + "\n"), b"\n" + encode(last), "lines")
    return joined.data.decode("utf-8", "surrogateescape"), "lines between its first and its last are left out"


def _merge(head: list[str], tail: list[str]) -> list[str]:
    if not tail:
        return head
    return head[: head.index(tail[0])] + tail if tail[0] in head else tail
