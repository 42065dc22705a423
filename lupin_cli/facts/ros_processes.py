"""The running ROS processes, with the environment that each was started in: it alone decides a node's DDS mode.

A ROS process is one that has mapped a ROS client library, Fast DDS or Cyclone DDS, whatever its name is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, integer, number, parse_sections

_LIBRARIES = r"lib(rcl|fastrtps|fastdds|ddsc|rmw_[a-z_]+_cpp)\.so"
# Processes in containers with their own network namespace are visible in /proc, but count as other machines.
FILTER_NETWORK_NAMESPACE = """near=
for pid in $pids; do [ "/proc/$pid/ns/net" -ef /proc/self/ns/net ] && near="$near $pid"; done
pids=$near"""
_VARIABLES = "(ROS_|RMW_|FASTRTPS_|FASTDDS_|CYCLONEDDS_|MIRTE_|LUPIN_|VIRTUAL_ENV=)"
PROBE = (
    PRELUDE
    + rf"""pids=$(grep -lsE '{_LIBRARIES}' /proc/[0-9]*/maps | cut -d/ -f3)
{FILTER_NETWORK_NAMESPACE}
files() {{ for pid in $pids; do echo "/proc/$pid/$1"; done; }}
echo '@@ uptime'; cat /proc/uptime
echo '@@ ticks'; getconf CLK_TCK
[ -n "$pids" ] || {{ printf '@@ %s\n' stat parents user group libraries command environment memory; exit 0; }}
echo '@@ stat'; grep -Hs '' $(files stat) /dev/null
echo '@@ parents'; grep -Hs '' $(grep -hs '' $(files stat) | sed 's,.*) . \([0-9]*\).*,/proc/\1/comm,' | sort -u) /dev/null
echo '@@ user'; grep -Hs '^Uid:' $(files status) /dev/null
echo '@@ group'; grep -Hs '' $(files cgroup) /dev/null
echo '@@ libraries'; grep -HosE '{_LIBRARIES}' $(files maps) /dev/null | sort -u
echo '@@ command'; grep -zHas '' $(files cmdline) /dev/null | tr '\n\0' ' \n'
echo '@@ environment'; grep -zHasE '^{_VARIABLES}' $(files environ) /dev/null | tr '\n\0' ' \n'
echo '@@ memory'; stat -L -c '%n:%d' $(files root/dev/shm) 2>/dev/null
exit 0
"""
)


def domain_id(environment: Mapping[str, str]) -> int:
    """Return the DDS domain that variables select; 0 if none."""
    text = environment.get("ROS_DOMAIN_ID", "")
    return int(text) if text.isdigit() else 0


# The kernel gives a process whose own parent has exited to one of these: PID 1, or the service manager of the user.
# The first process of a container is often a shell, whose programs have not lost their parent; the child of tini, docker-init
# or containerd-shim is the container's own program.
_ADOPTERS = ("systemd", "init")


def adopts(pid: int, name: str) -> bool:
    """Return whether a parent is one to which the kernel gives orphans. If its name is not readable, only PID 1 is."""
    return name in _ADOPTERS if name else pid == 1


@dataclass(frozen=True)
class RosProcess:
    """One process that participates in a ROS graph."""

    pid: int
    parent: int
    user_id: int
    state: str  # R running, S and D waiting, T stopped
    age_s: float
    group: str  # its control group, which names its systemd unit or session
    arguments: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)  # only variables of ROS, DDS and Lupin
    libraries: frozenset[str] = frozenset()
    shared_memory: str = ""  # device number of the file system that it has at /dev/shm
    parent_name: str = ""  # cut to 15 characters by the kernel; empty if it is not readable

    @property
    def command(self) -> str:
        """Its command line."""
        return " ".join(self.arguments)

    @property
    def name(self) -> str:
        """The node name from its arguments, or else a short name for its program."""
        for argument in self.arguments:
            if "__node:=" in argument:
                return argument.partition("__node:=")[2]
        words = [PurePosixPath(argument).name for argument in self.arguments[:2]] + list(self.arguments[2:])
        if words and re.fullmatch(r"(python|ruby|node|bash|sh)[0-9.]*", words[0]):
            script = [word for word in words[1:] if word and not word.startswith("-")]
            if script[:1] == ["lupin_runtime.stack.process"] and len(script) > 1:
                return PurePosixPath(script[1]).stem  # a row of the stack's process table
            return " ".join(script[:2])[:40].strip() or words[0]
        return words[0] if words else f"process {self.pid}"

    def may_run(self, node: str) -> bool:
        """Return whether it may run the node of this full name, by its arguments, its program, or a PID in the node's name."""
        name = node.rpartition("/")[2]
        given = [argument.partition("__node:=")[2] for argument in self.arguments if "__node:=" in argument]
        if given:
            return name in given
        program = self.name.split(" ")[0]
        if name == program or any(self.name.startswith(known) and name in nodes for known, nodes in _NODES.items()):
            return True
        return program in _NAMED_BY_PID and name in (f"{prefix}_{self.pid}" for prefix in _NAMED_BY_PID[program])

    @property
    def domain(self) -> int:
        """Its DDS domain; 0 if ROS_DOMAIN_ID is unset or not a number (which rcl rejects)."""
        return domain_id(self.environment)

    @property
    def server(self) -> str:
        """Its ROS_DISCOVERY_SERVER; empty for discovery by multicast only."""
        return self.environment.get("ROS_DISCOVERY_SERVER", "").strip()

    @property
    def profile(self) -> str:
        """The path of the Fast DDS profile in its environment; empty if it has none."""
        names = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
        return next((self.environment[name] for name in names if self.environment.get(name)), "")

    @property
    def rmw(self) -> str:
        """The RMW implementation that it has loaded, judged by the DDS library if no RMW library is mapped."""
        for library, name in _MIDDLEWARE:
            if library in self.libraries:
                return name
        return ""

    @property
    def is_daemon(self) -> bool:
        """Whether it is the daemon of the `ros2` command."""
        return any("ros2cli.daemon" in argument or "_ros2_daemon" in argument for argument in self.arguments)

    @property
    def is_graph_probe(self) -> bool:
        """Whether it is the graph probe of a `lupin doctor`, which runs only for seconds."""
        return "lupin_runtime.stack.graph_probe" in self.arguments

    @property
    def is_server(self) -> bool:
        """Whether it is a discovery server."""
        return any("fast-discovery-server" in argument for argument in self.arguments[:2]) or (
            "fastdds" in self.command and " discovery" in self.command
        )

    @property
    def is_lupin(self) -> bool:
        """Whether it is a `lupin` command: a run may outlive the terminal that it was started in."""
        return any(argument == "lupin_cli.app" or argument.endswith("/lupin") for argument in self.arguments[:3])

    @property
    def stale_reason(self) -> str:
        """Why the process counts as stale, left over by a launch that died; empty if it does not.

        A stopped process does not respond, whatever started it. Services, daemons and runs of Lupin have no parent by design.
        """
        if self.state in ("T", "t"):
            return "it is stopped (as by Ctrl-Z) and does not respond"
        if not self.arguments:
            return ""  # it is ending: its memory has gone, and its sockets are about to
        if self.is_daemon or self.is_server or self.is_lupin or self.supervisor or not adopts(self.parent, self.parent_name):
            return ""
        return "its parent is gone"

    @property
    def supervisor(self) -> str:
        """The service that its control group names, whose manager supervises it; empty if a person started it."""
        unit = self.group.rpartition("/")[2]
        return unit if unit.endswith(".service") and not unit.startswith("user@") else ""

    def line(self, *variables: str) -> str:
        """Return the process with some of its environment variables, or with its command if none are given."""
        shown = " ".join(f"{name}={self.environment.get(name, '')}" for name in variables)
        return f"/proc/{self.pid}/environ ({self.name}): {shown}" if variables else f"{self.pid} {self.command}"


# Programs whose nodes have another name than they have, or one that ends with their PID.
_NODES: Mapping[str, tuple[str, ...]] = {
    "rviz2": ("rviz",),
    "ros2 bag": ("rosbag2_player", "rosbag2_recorder"),
    "teleop_node": ("teleop_twist_joy_node",),
}
_NAMED_BY_PID: Mapping[str, tuple[str, ...]] = {
    "ros2": ("_ros2cli", "launch_ros"),
    "rqt": ("rqt_gui_py_node", "rqt_gui_cpp_node"),
}
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
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    uptime_s, ticks = sections.number("uptime"), sections.number("ticks")
    sections.lines("memory")  # missing if the probe was cut off
    users, groups = _by_pid(sections.lines("user")), _by_pid(sections.lines("group"))
    commands, variables = _by_pid(sections.lines("command")), _by_pid(sections.lines("environment"))
    libraries, memory = _by_pid(sections.lines("libraries")), _by_pid(sections.lines("memory"))
    names = _by_pid(sections.lines("parents"))
    found = []
    for pid, lines in _by_pid(sections.lines("stat")).items():
        # The name may contain anything, also line breaks; the fields after the last parenthesis may not (proc(5)).
        line = "\n".join(lines)
        words = line.rpartition(")")[2].split()
        if len(words) < 20:
            raise ValueError(f"expected a line of /proc/{pid}/stat, found {line[:80]!r}")
        parent = integer(words[1], "a parent PID")
        found.append(
            RosProcess(
                pid=pid,
                parent=parent,
                user_id=integer((users.get(pid) or ["Uid: -1"])[0].split()[1], "a user ID"),
                state=words[0],
                age_s=round(uptime_s - number(words[19], "a start time") / ticks, 2),
                group=(groups.get(pid) or [""])[-1].split(":", 2)[-1],
                arguments=tuple(commands.get(pid, ())),
                environment=dict(each.split("=", 1) for each in variables.get(pid, ()) if "=" in each),
                libraries=frozenset(libraries.get(pid, ())),
                shared_memory=(memory.get(pid) or [""])[0],
                parent_name=(names.get(parent) or [""])[0],
            )
        )
    return tuple(sorted(found, key=lambda process: process.pid))


_PID_LINE = re.compile(r"/proc/(\d+)/[a-z/]+:(.*)")


def _by_pid(lines: tuple[str, ...]) -> dict[int, list[str]]:
    found: dict[int, list[str]] = {}
    for line in lines:
        if match := _PID_LINE.match(line):
            found.setdefault(int(match[1]), []).append(match[2])
    return found


ROS_PROCESSES = Fact("ros-processes", PROBE, parse)
