"""The lease on a robot: only one playbook run at a time changes it, and a second operator learns who holds the lease.

The lease is a folder in /run, so that a full or read-only disk does not prevent repairs and a reboot ends it. A run takes it
before its first step and gives it back at its end. A lease left by a killed run or a cut link is taken over by the next run
of the same operator; anyone else waits, or takes it from its holder by name.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import shlex
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import Target, TargetError, Unreachable
from lupin_cli.connection.this_operator import this_operator
from lupin_cli.operations.base import OperationError
from lupin_runtime.json_text import parse_json

LEASE_PATH = "/run/lupin-lease"
LONGEST_RUN_S = 3600  # no shipped playbook runs longer; an older lease belongs to a run that is probably dead
_TAKEN = 7
_TIMEOUT_S = 20.0

# A complete folder is renamed into place, so a lease always has its owner's name in it; `mv` fails if the lease is taken. Its
# age comes from the uptime, since the robot's wall clock may be wrong.
_TAKE = """set -eu
umask 022
new=$(mktemp -d {path}.XXXXXX)
trap 'rm -rf "$new"' EXIT
chmod 755 "$new"
cat >"$new/owner"
cut -d. -f1 /proc/uptime >"$new/up"
if mv -T "$new" {path} 2>/dev/null; then trap - EXIT; exit 0; fi
[ -f {path}/owner ] || {{ echo {path} 'exists, but is not a lease' >&2; exit 1; }}
echo "$(($(cat "$new/up") - $(cat {path}/up)))"
cat {path}/owner
exit {taken}
"""
_GIVE_BACK = "if grep -qF -e {nonce} {path}/owner 2>/dev/null; then rm -rf {path}; fi"
_READ = """[ -e {path} ] || exit 0
echo "$(($(cut -d. -f1 /proc/uptime) - $(cat {path}/up 2>/dev/null || echo 0)))"
cat {path}/owner 2>/dev/null || true
"""


class LeaseTaken(OperationError):
    """Another run holds the robot's lease."""


@dataclass(frozen=True)
class Holder:
    """Who holds a robot's lease, what for, and since when."""

    who: str  # user@machine
    purpose: str  # the command that the holder typed
    age_s: int
    nonce: str = ""
    record: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.who} ({self.purpose}), for {_duration(self.age_s)} now"

    @property
    def is_stale(self) -> bool:
        """Whether the lease is this operator's, on this machine, and its process or its run in this process has ended."""
        return _is_stale(self.record)


_live_nonces: set[str] = set()  # of the leases of this process


class Lease:
    """The right to change one robot, for one playbook run. `purpose` tells other operators what the run does.

    `take_from` names a holder whose lease is taken as if it were stale.
    """

    def __init__(self, target: Target, purpose: str, *, take_from: str = "", path: str = "") -> None:
        self._target, self._purpose, self._take_from, self._path = target, purpose, take_from, path or LEASE_PATH
        self._nonce = secrets.token_hex(8)
        self.held = False
        self.reachable = True  # if false, the lease stays on the robot

    def take(self) -> bool:
        """Take the lease. Returns True if it was taken just now, False if this run already had it. Raises LeaseTaken, which
        names the holder, or OperationError."""
        if self.held:
            return False
        owner = {**_this_process(), "what": self._purpose, "nonce": self._nonce}
        _live_nonces.add(self._nonce)
        for _ in range(2):
            status, printed = self._run(_TAKE.format(path=shlex.quote(self._path), taken=_TAKEN), json.dumps(owner))
            if status == 0:
                self.held = True
                return True
            if status != _TAKEN:
                raise OperationError(
                    f"{self._target.name}: the lease could not be taken: {printed.strip()}",
                    f"lupin doctor --robot {self._target.name}",
                )
            holder = _parse_holder(printed)
            if not holder.is_stale and holder.who != self._take_from:
                break
            self._remove_lease_of(holder)
        raise LeaseTaken(self._explain(holder), f"lupin wait free --robot {self._target.name}")

    def _explain(self, holder: Holder) -> str:
        text = f"{self._target.name} is being changed by {holder}"
        if self._take_from:
            return f"{text}, not by {self._take_from}"
        if holder.age_s <= LONGEST_RUN_S:
            return f"{text}; wait until that run has ended"
        return f"{text}, longer than any run takes; if it is dead, add: --break-lease {shlex.quote(holder.who)}"

    def _remove_lease_of(self, holder: Holder) -> None:
        # The nonce makes sure that no lease is removed which somebody has taken since.
        self._run(self._give_back_script(holder.nonce) if holder.nonce else f"rm -rf {shlex.quote(self._path)}")

    def _give_back_script(self, nonce: str) -> str:
        return _GIVE_BACK.format(path=shlex.quote(self._path), nonce=shlex.quote(nonce))

    def end(self) -> None:
        """Give the lease back. If the robot is not reachable, it stays there, and the operator's next run takes it over."""
        _live_nonces.discard(self._nonce)
        if self.held and self.reachable:
            with contextlib.suppress(TargetError, OperationError):  # the run's own result matters more
                self._run(self._give_back_script(self._nonce))
        self.held = False

    def forget(self) -> None:
        """Note that the robot was rebooted, which ended the lease."""
        self.held = False

    def _run(self, script: str, owner: str = "") -> tuple[int, str]:
        output = self._target.run(script, root=True, stdin=owner.encode(), timeout_s=_TIMEOUT_S)
        if output.status is None:
            raise Unreachable(
                f"{self._target.name} did not answer the request for its lease: {output.stderr.strip()}",
                "lost",
                f"lupin doctor --robot {self._target.name}",
            )
        return output.status, output.stdout or output.stderr


def read_holder(target: Target, path: str = "") -> Holder | None:
    """Return who holds the lease of a robot; None if it is free. Needs no root. Raises TargetError."""
    output = target.run(_READ.format(path=shlex.quote(path or LEASE_PATH)), timeout_s=_TIMEOUT_S)
    if not output.ok:
        raise Unreachable(
            f"{target.name} did not say who holds its lease: {output.stderr.strip()}",
            "lost",
            f"lupin doctor --robot {target.name}",
        )
    return _parse_holder(output.stdout) if output.stdout else None


def _this_process() -> dict[str, Any]:
    """Return the owner of a lease: a name for people; machine, boot and process to tell a stale lease from a live one."""
    # Containers of one machine may share its id, and each numbers its processes from 1.
    identity = [_read("/etc/machine-id").decode().strip(), socket.gethostname(), str(Path("/proc/self/ns/pid").readlink())]
    return {
        "who": this_operator(),
        "uid": os.getuid(),
        "machine": hashlib.sha256("\0".join(identity).encode("utf-8", "surrogateescape")).hexdigest()[:16],
        "boot": _read("/proc/sys/kernel/random/boot_id").decode().strip(),
        "pid": os.getpid(),
        "started": _start_ticks(os.getpid()),
    }


def _parse_holder(printed: str) -> Holder:
    """Read a lease's age in s, on a line of its own, and its owner."""
    age_text, _, text = printed.partition("\n")
    record = {}
    with contextlib.suppress(ValueError):  # not written by Lupin
        found = parse_json(text)
        record = found if isinstance(found, dict) else {}
    age_s = int(age_text) if age_text.strip().isdecimal() else 0
    who, purpose = str(record.get("who", "somebody")), str(record.get("what", "unknown"))
    return Holder(who, purpose, age_s, str(record.get("nonce", "")), record)


def _duration(seconds: int) -> str:
    if seconds < 120:
        return f"{seconds} s"
    return f"{seconds // 60} min" if seconds < 7200 else f"{seconds // 3600} h"


def _is_stale(holder: Mapping[str, Any]) -> bool:
    own = _this_process()
    if any(holder.get(key) != own[key] for key in ("machine", "uid")):
        return False
    if holder.get("boot") != own["boot"] or _start_ticks(holder.get("pid")) != holder.get("started"):
        return True
    return holder.get("pid") == own["pid"] and holder.get("nonce") not in _live_nonces


def _start_ticks(pid: object) -> str:
    """Return the start of a process in clock ticks since boot, since PIDs are reused; empty if there is no such process."""
    # The second field is a name in parentheses, which may contain anything; the start is the 20th field after it (proc(5)).
    if type(pid) is not int:  # it may come from a robot
        return ""
    fields = _read(f"/proc/{pid}/stat").rpartition(b")")[2].split()
    return fields[19].decode() if len(fields) > 19 else ""


def _read(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError:
        return b""
