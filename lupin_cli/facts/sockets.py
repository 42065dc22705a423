"""Listening sockets and their owners. The owners of other users' sockets are only known to root."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, integer, parse_sections
from lupin_runtime.ports import DISCOVERY_PORT, VIDEO_PORT

# ss may omit the owner of a socket that was just opened, so it is run again if all owners are missing. If another user owns
# the port of the discovery server or of the cameras, it is run as root, since that owner is always needed.
PROBE = (
    PRELUDE
    + r"""found=$(ss -H -lntup) || exit 1
case $found in *udp*) printf '%s\n' "$found" | grep -q '^udp.*users:' || { sleep 0.1; found=$(ss -H -lntup); } ;; esac
"""
    + rf"""unowned=$(printf '%s\n' "$found" | grep -E ':({DISCOVERY_PORT}|{VIDEO_PORT})[[:space:]]' | grep -v 'users:')
"""
    + r"""[ -z "$unowned" ] || { sudo -n true 2>/dev/null && found=$(sudo -n ss -H -lntup); }
echo '@@ sockets'; printf '%s\n' "$found"
pids=$(printf '%s\n' "$found" | grep -oE 'pid=[0-9]+' | cut -d= -f2 | sort -un)
echo '@@ commands'; grep -zHas '' $(for pid in $pids; do echo "/proc/$pid/cmdline"; done) /dev/null | tr '\n\0' ' \n'
exit 0
"""
)

_OWNER = re.compile(r'\("((?:[^"\\]|\\.)*)",pid=(\d+),fd=\d+\)')


@dataclass(frozen=True)
class Socket:
    """A listening or bound socket. `pid` is 0 if the owner is unknown."""

    protocol: str  # tcp or udp
    address: str  # 0.0.0.0, [::], * or one address, without the interface
    port: int
    process: str = ""  # name of the process, cut to 15 characters by the kernel
    pid: int = 0
    command: str = ""
    raw: str = ""

    @property
    def is_wildcard(self) -> bool:
        """Whether it is bound to all addresses."""
        return self.address in ("0.0.0.0", "*", "[::]")

    def line(self) -> str:
        """Return the line of ss(8) without padding."""
        return " ".join(self.raw.split())


@dataclass(frozen=True)
class Sockets:
    """All listening TCP sockets and all bound UDP sockets."""

    entries: tuple[Socket, ...]

    def on(self, protocol: str, port: int) -> tuple[Socket, ...]:
        """Return the sockets of one port."""
        return tuple(each for each in self.entries if (each.protocol, each.port) == (protocol, port))

    def of(self, pid: int) -> tuple[Socket, ...]:
        """Return the sockets of one process."""
        return tuple(each for each in self.entries if each.pid == pid)


def parse(output: Output) -> Sockets:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    commands = _commands(sections.lines("commands"))
    found = []
    for line in sections.lines("sockets"):
        words = line.split(None, 6)
        if len(words) < 6 or words[0] not in ("tcp", "udp"):
            raise ValueError(f"expected a line of ss(8), found {line[:80]!r}")
        address, _, port = words[4].rpartition(":")
        owners = _OWNER.findall(words[6]) if len(words) > 6 else []
        for name, pid in owners or [("", "0")]:
            found.append(
                Socket(
                    protocol=words[0],
                    address=address.split("%")[0],
                    port=integer(port, "a port"),
                    process=name,
                    pid=int(pid),
                    command=commands.get(int(pid), ""),
                    raw=line,
                )
            )
    return Sockets(tuple(found))


_COMMAND = re.compile(r"/proc/(\d+)/cmdline:(.*)")


def _commands(lines: tuple[str, ...]) -> dict[int, str]:
    """Return command lines by PID, from lines that each have the file of a process and one argument."""
    commands: dict[int, list[str]] = {}
    for line in lines:
        if found := _COMMAND.match(line):
            commands.setdefault(int(found[1]), []).append(found[2])
    return {pid: " ".join(arguments) for pid, arguments in commands.items()}


SOCKETS = Fact("sockets", PROBE, parse)
