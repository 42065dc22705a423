"""The user that Lupin works as: groups, sudo, locale, time zone."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import Answers, answers
from lupin_cli.target.base import Output

FIRST_PERSON = 1000  # of Debian's and Ubuntu's user ids

# The prelude would hide the locale that is asked for here.
PROBE = """echo '@@ locale'; echo "${LC_ALL:-${LC_NUMERIC:-${LANG:-}}}"
echo '@@ locale-works'; if command -v locale >/dev/null 2>&1; then locale 2>&1 >/dev/null; fi
LC_ALL=C; export LC_ALL; PATH="$PATH:/usr/sbin:/sbin"
echo '@@ user'; id -un
echo '@@ uid'; id -u
echo '@@ groups'; id -Gn
echo '@@ known-groups'; for g in input video dialout plugdev; do getent group "$g" 2>/dev/null | cut -d: -f1; done
echo '@@ home'; printf '%s\\n' "$HOME"
echo '@@ home-writable'; [ -w "$HOME" ] && echo yes || echo no
echo '@@ sudo'
if [ "$(id -u)" = 0 ]; then echo root; elif ! command -v sudo >/dev/null 2>&1; then echo none
elif sudo -n true 2>/dev/null; then echo nopasswd; else echo password; fi
# busctl's word is what logind does, whatever its files say by now.
echo '@@ memory'
busctl get-property org.freedesktop.login1 /org/freedesktop/login1 org.freedesktop.login1.Manager RemoveIPC 2>/dev/null
echo '@@ lingers'; [ -e "/var/lib/systemd/linger/$(id -un)" ] && echo yes || echo no
echo '@@ zone'; readlink /etc/localtime; echo "$(date +%z)"
echo '@@ end'
"""


@dataclass(frozen=True)
class Account:
    """One user of one machine."""

    user: str
    uid: int
    groups: tuple[str, ...]
    known_groups: tuple[str, ...]  # of those that devices belong to, the ones that this machine has
    home: str
    home_writable: bool
    sudo: str  # root | nopasswd | password | none
    locale: str
    locale_broken: tuple[str, ...]  # what `locale` complains of
    utc_offset: str  # +0100
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
        sudo=said.text("sudo"),
        locale=said.text("locale"),
        locale_broken=said.lines("locale-works"),
        utc_offset=said.lines("zone")[-1].strip() if said.lines("zone") else "",
        loses_memory=_loses_memory(said, int(uid)),
    )


def _loses_memory(said: Answers, uid: int) -> bool:
    """Users of the system, and those that linger, are spared (logind.conf(5))."""
    memory, lingers = said.maybe("memory"), said.maybe("lingers")
    told = memory is not None and memory.text == "b true"
    return told and uid >= FIRST_PERSON and lingers is not None and lingers.text == "no"


ACCOUNT = Fact("account", PROBE, parse)
