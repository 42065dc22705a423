"""Every running ROS process, with the environment that it was started in: a node's DDS mode is fixed there, and nowhere else.

A process counts as one where a ROS client library, Fast DDS or Cyclone DDS is mapped into it, whatever it is called.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import field
from pathlib import PurePosixPath

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers, integer, number
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

_LIBRARIES = r"lib(rcl|fastrtps|fastdds|ddsc|rmw_[a-z_]+_cpp)\.so"
# Containers with a network of their own are other machines, though their processes show in /proc here.
SAME_NETWORK = """near=
for pid in $pids; do [ "/proc/$pid/ns/net" -ef /proc/self/ns/net ] && near="$near $pid"; done
pids=$near"""
_VARIABLES = "(ROS_|RMW_|FASTRTPS_|FASTDDS_|CYCLONEDDS_|MIRTE_|LUPIN_|VIRTUAL_ENV=)"
PROBE = (
    PRELUDE
    + rf"""pids=$(grep -lsE '{_LIBRARIES}' /proc/[0-9]*/maps | cut -d/ -f3)
{SAME_NETWORK}
files() {{ for pid in $pids; do echo "/proc/$pid/$1"; done; }}
echo '@@ uptime'; cat /proc/uptime
echo '@@ ticks'; getconf CLK_TCK
[ -n "$pids" ] || {{ printf '@@ %s\n' stat user group libraries command environment memory; exit 0; }}
echo '@@ stat'; grep -Hs '' $(files stat) /dev/null
echo '@@ user'; grep -Hs '^Uid:' $(files status) /dev/null
echo '@@ group'; grep -Hs '' $(files cgroup) /dev/null
echo '@@ libraries'; grep -HosE '{_LIBRARIES}' $(files maps) /dev/null | sort -u
echo '@@ command'; grep -zHas '' $(files cmdline) /dev/null | tr '\n\0' ' \n'
echo '@@ environment'; grep -zHasE '^{_VARIABLES}' $(files environ) /dev/null | tr '\n\0' ' \n'
echo '@@ memory'; stat -L -c '%n:%d' $(files root/dev/shm) 2>/dev/null
exit 0
"""
)


@dataclass(frozen=True)
class RosProcess:
    """One process that takes part in a graph."""

    pid: int
    parent: int
    user_id: int
    state: str  # R running, S and D waiting, T stopped
    age_s: float
    group: str  # its control group: a unit of systemd, a session
    arguments: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)  # of ROS and DDS only
    libraries: frozenset[str] = frozenset()
    shared_memory: str = ""  # the file system that it sees as /dev/shm

    @property
    def command(self) -> str:
        """Its command line."""
        return " ".join(self.arguments)

    @property
    def name(self) -> str:
        """The node it was told to be, or else the shortest name that tells it from others."""
        for argument in self.arguments:
            if "__node:=" in argument:
                return argument.partition("__node:=")[2]
        words = [PurePosixPath(argument).name for argument in self.arguments[:2]] + list(self.arguments[2:])
        if words and re.fullmatch(r"(python|ruby|node|bash|sh)[0-9.]*", words[0]):
            script = [word for word in words[1:] if word and not word.startswith("-")]
            if script[:1] == ["lupin_runtime.stack.process"] and len(script) > 1:
                return PurePosixPath(script[1]).stem  # one process of the stack's table, by its name there
            return " ".join(script[:2])[:40].strip() or words[0]
        return words[0] if words else f"process {self.pid}"

    @property
    def domain(self) -> int:
        """Its DDS domain; 0 where the variable is no number, as rcl would refuse it."""
        text = self.environment.get("ROS_DOMAIN_ID", "")
        return int(text) if text.isdigit() else 0

    @property
    def server(self) -> str:
        """The discovery server that it was told of; empty: multicast only."""
        return self.environment.get("ROS_DISCOVERY_SERVER", "").strip()

    @property
    def profile(self) -> str:
        """The XML profile that it was started with."""
        names = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
        return next((self.environment[name] for name in names if self.environment.get(name)), "")

    @property
    def rmw(self) -> str:
        """The middleware that is loaded; `rmw_fastrtps_cpp` also where only its library is there."""
        for library, name in _MIDDLEWARE:
            if library in self.libraries:
                return name
        return ""

    @property
    def is_daemon(self) -> bool:
        """Whether it is the daemon of the `ros2` command."""
        return any("ros2cli.daemon" in argument or "_ros2_daemon" in argument for argument in self.arguments)

    @property
    def is_visitor(self) -> bool:
        """Whether it is some doctor's visit to a graph: it comes and goes while others look."""
        return "lupin_runtime.stack.probe" in self.arguments

    @property
    def is_server(self) -> bool:
        """Whether it is a discovery server."""
        return any("fast-discovery-server" in argument for argument in self.arguments[:2]) or (
            "fastdds" in self.command and " discovery" in self.command
        )

    @property
    def is_lupin(self) -> bool:
        """Whether it is a `lupin` command: a run may go on without the terminal that it was typed in."""
        return any(argument == "lupin_cli.app" or argument.endswith("/lupin") for argument in self.arguments[:3])

    @property
    def outlived(self) -> str:
        """Why it must be taken for left over by a launch that died; empty where it need not.

        A stopped process answers nobody, whoever owns it. Services, daemons and runs of Lupin have no parent by design.
        """
        if self.state in ("T", "t"):
            return "it is stopped (as by Ctrl-Z), and answers nobody"
        if self.parent != 1 or self.is_daemon or self.is_server or self.is_lupin or self.group.endswith(".service"):
            return ""
        return "its parent is gone"

    def line(self, *variables: str) -> str:
        """The process with the variables that matter, as `/proc/PID/environ` has them."""
        shown = " ".join(f"{name}={self.environment.get(name, '')}" for name in variables)
        return f"/proc/{self.pid}/environ ({self.name}): {shown}" if variables else f"{self.pid} {self.command}"


_MIDDLEWARE = (
    ("librmw_cyclonedds_cpp.so", "rmw_cyclonedds_cpp"),
    ("librmw_zenoh_cpp.so", "rmw_zenoh_cpp"),
    ("librmw_connextdds_cpp.so", "rmw_connextdds"),
    ("librmw_fastrtps_dynamic_cpp.so", "rmw_fastrtps_dynamic_cpp"),
    ("librmw_fastrtps_cpp.so", "rmw_fastrtps_cpp"),
    ("libddsc.so", "rmw_cyclonedds_cpp"),
    ("libfastrtps.so", "rmw_fastrtps_cpp"),
    ("libfastdds.so", "rmw_fastrtps_cpp"),
)


def parse(output: Output) -> tuple[RosProcess, ...]:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    uptime_s, ticks = said.number("uptime"), said.number("ticks")
    said.lines("memory")  # a probe that was cut has not said all
    users, groups = _by_pid(said.lines("user")), _by_pid(said.lines("group"))
    commands, variables = _by_pid(said.lines("command")), _by_pid(said.lines("environment"))
    libraries, memory = _by_pid(said.lines("libraries")), _by_pid(said.lines("memory"))
    found = []
    for pid, (line, *_) in _by_pid(said.lines("stat")).items():
        # The name may hold spaces and parentheses; what follows the last one may not (proc(5)).
        words = line.rpartition(")")[2].split()
        if len(words) < 20:
            raise ValueError(f"expected a line of /proc/{pid}/stat, found {line[:80]!r}")
        found.append(
            RosProcess(
                pid=pid,
                parent=integer(words[1], "a parent"),
                user_id=integer((users.get(pid) or ["Uid: -1"])[0].split()[1], "a user"),
                state=words[0],
                age_s=round(uptime_s - number(words[19], "a start time") / ticks, 2),
                group=(groups.get(pid) or [""])[-1].split(":", 2)[-1],
                arguments=tuple(commands.get(pid, ())),
                environment=dict(each.split("=", 1) for each in variables.get(pid, ()) if "=" in each),
                libraries=frozenset(libraries.get(pid, ())),
                shared_memory=(memory.get(pid) or [""])[0],
            )
        )
    return tuple(sorted(found, key=lambda process: process.pid))


_OF_PID = re.compile(r"/proc/(\d+)/[a-z/]+:(.*)")


def _by_pid(lines: tuple[str, ...]) -> dict[int, list[str]]:
    found: dict[int, list[str]] = {}
    for line in lines:
        if match := _OF_PID.match(line):
            found.setdefault(int(match[1]), []).append(match[2])
    return found


ROS_PROCESSES = Fact("ros-processes", PROBE, parse)
