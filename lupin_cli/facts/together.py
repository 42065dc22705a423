"""Probes that share a shell: a script of its own costs a small board 8 ms, more than some questions take.

Only for those that nothing keeps waiting, since one that hangs keeps the others.
"""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Sequence
from dataclasses import replace

from lupin_cli.target.base import Output


def together(probes: Sequence[str]) -> str:
    """sh that runs one probe after the other, each in a subshell: neither its `exit` nor its syntax concerns the next."""
    mark = _mark(probes)
    return "".join(
        f"read -r since rest </proc/uptime\n( eval {shlex.quote(probe)} )\nstatus=$?; read -r now rest </proc/uptime\n"
        f"printf '\\n{mark} %s %s %s\\n' $status $since $now; echo {mark} >&2\n"
        for probe in probes
    )


def _mark(probes: Sequence[str]) -> str:
    """What ends every answer: nothing that any of them prints, and the same whenever the same is asked."""
    return hashlib.sha256("\n".join(probes).encode("utf-8", "surrogateescape")).hexdigest()[:16]


def apart(whole: Output, probes: Sequence[str]) -> tuple[Output, ...]:
    """What each of `probes` left, in their order. What was cut before its end is what the whole is: cut at a bound, too long,
    or ended by somebody."""
    mark = _mark(probes)
    first, *others = whole.stdout.split(f"\n{mark} ")
    told = [("", first), *((ending, body) for ending, _, body in (other.partition("\n") for other in others))]
    complaints = f"{whole.stderr}\n".split(f"{mark}\n")
    found = []
    for place in range(len(probes)):
        stdout = told[place][1] if place < len(told) else ""
        stderr = complaints[place].rstrip("\n") if place < len(complaints) else ""
        words = told[place + 1][0].split() if place + 1 < len(told) else []
        if len(words) == 3:
            found.append(Output(int(words[0]), stdout, stderr, float(words[2]) - float(words[1])))
        else:
            status = whole.status if place < len(told) else None
            found.append(replace(whole, status=status, stdout=stdout, stderr=stderr, truncated=True))
    return tuple(found)
