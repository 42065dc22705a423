"""The user that Lupin works as: groups, home, and whether the last login takes the shared memory away."""

from __future__ import annotations

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Answers, answers
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

FIRST_PERSON = 1000  # of Debian's and Ubuntu's user ids

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
# busctl's word is what logind does, whatever its files say by now.
echo '@@ memory'
busctl get-property org.freedesktop.login1 /org/freedesktop/login1 org.freedesktop.login1.Manager RemoveIPC 2>/dev/null
echo '@@ lingers'; [ -e "/var/lib/systemd/linger/$user" ] && echo yes || echo no
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Account:
    """One user of one machine."""

    user: str
    uid: int
    groups: tuple[str, ...]
    known_groups: tuple[str, ...]  # of those that devices belong to, the ones that this machine has
    home: str
    home_writable: bool
    loses_memory: bool = False  # logind removes the user's shared memory when the last login ends, whatever still runs


def parse(output: Output) -> Account:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    said.lines("end")
    uid = said.text("uid")
    if not uid.isdigit():
        raise ValueError(f"expected a user id, found {uid!r}")
    return Account(
        user=said.text("user"),
        uid=int(uid),
        groups=tuple(said.text("groups").split()),
        known_groups=tuple(line.strip() for line in said.lines("known-groups")),
        home=said.text("home"),
        home_writable=said.text("home-writable") == "yes",
        loses_memory=_loses_memory(said, int(uid)),
    )


def _loses_memory(said: Answers, uid: int) -> bool:
    """Users of the system, and those that linger, are spared (logind.conf(5))."""
    memory, lingers = said.maybe("memory"), said.maybe("lingers")
    told = memory is not None and memory.text == "b true"
    return told and uid >= FIRST_PERSON and lingers is not None and lingers.text == "no"


ACCOUNT = Fact("account", PROBE, parse)
