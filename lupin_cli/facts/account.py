"""The user account that Lupin runs as: groups, home, and whether logind removes its shared memory after the last logout."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Sections, parse_sections

FIRST_REGULAR_UID = 1000  # on Debian and Ubuntu; lower IDs belong to system users

PROBE = (
    PRELUDE
    + """user=$(id -un)
uid=$(id -u)
echo '@@ user'; echo "$user"
echo '@@ uid'; echo "$uid"
echo '@@ groups'; id -Gn
echo '@@ known-groups'; getent group input video dialout plugdev 2>/dev/null | cut -d: -f1
echo '@@ home'; printf '%s\\n' "$HOME"
echo '@@ home-writable'; [ -w "$HOME" ] && echo yes || echo no
# logind's property is in force now; its configuration files may have changed since it started.
echo '@@ memory'
busctl get-property org.freedesktop.login1 /org/freedesktop/login1 org.freedesktop.login1.Manager RemoveIPC 2>/dev/null
echo '@@ lingers'; [ -e "/var/lib/systemd/linger/$user" ] && echo yes || echo no
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Account:
    """A user account on one machine."""

    user: str
    uid: int
    groups: tuple[str, ...]
    known_groups: tuple[str, ...]  # the groups of devices (input, video, ...) that exist on this machine
    home: str
    home_writable: bool
    loses_memory: bool = False  # logind removes the user's shared memory after the last logout, even if processes still use it


def parse(output: Output) -> Account:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    uid = sections.text("uid")
    if not uid.isdigit():
        raise ValueError(f"expected a user id, found {uid!r}")
    return Account(
        user=sections.text("user"),
        uid=int(uid),
        groups=tuple(sections.text("groups").split()),
        known_groups=tuple(line.strip() for line in sections.lines("known-groups")),
        home=sections.text("home"),
        home_writable=sections.text("home-writable") == "yes",
        loses_memory=_loses_memory(sections, int(uid)),
    )


def _loses_memory(sections: Sections, uid: int) -> bool:
    """Return whether logind removes the user's shared memory. System users and lingering users are exempt (logind.conf(5))."""
    memory, lingers = sections.get("memory"), sections.get("lingers")
    remove_ipc = memory is not None and memory.text == "b true"
    return remove_ipc and uid >= FIRST_REGULAR_UID and lingers is not None and lingers.text == "no"


ACCOUNT = Fact("account", PROBE, parse)
