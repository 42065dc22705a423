"""A lease on a robot: of two operators who change it at once, the second is told who the first is.

It lies in /run, so that a full or read-only disk keeps nobody from mending a robot, and a reboot ends it. It is taken before
the first change, and given back at the end of the run. What a killed run or a cut link left is taken over by its own operator's
next run; anybody else has to break it.
"""

from __future__ import annotations

import contextlib
import getpass
import hashlib
import json
import os
import secrets
import socket
from pathlib import Path
from typing import Any

from lupin_cli.operations.base import OperationError
from lupin_cli.target.base import Target, TargetError, Unreachable

PLACE = "/run/lupin-lease"
TAKEN = 7
BOUND_S = 20.0

# A whole folder is renamed into place, so there is none without its owner's name in it; a taken one makes `mv` fail. Its age
# comes from the uptime, since the robot's wall clock may say anything.
_TAKE = """set -eu
umask 022
new=$(mktemp -d {place}.XXXXXX)
trap 'rm -rf "$new"' EXIT
chmod 755 "$new"
cat >"$new/owner"
cut -d. -f1 /proc/uptime >"$new/up"
if mv -T "$new" {place} 2>/dev/null; then trap - EXIT; exit 0; fi
[ -f {place}/owner ] || {{ echo "{place} is in the way, and no lease" >&2; exit 1; }}
echo "$(($(cat "$new/up") - $(cat {place}/up)))"
cat {place}/owner
exit {taken}
"""
_GIVE_BACK = "if grep -qF {nonce} {place}/owner 2>/dev/null; then rm -rf {place}; fi"


class LeaseTaken(OperationError):
    """Somebody else has it."""


_of_live_runs: set[str] = set()  # nonces of this process


class Lease:
    """The right to change one robot, for one run of a playbook. `what` tells others what it is used for."""

    def __init__(self, target: Target, what: str, *, break_it: bool = False, place: str = "") -> None:
        self._target, self._what, self._break_it, self._place = target, what, break_it, place or PLACE
        self._nonce = secrets.token_hex(8)
        self.held = False

    def take(self) -> bool:
        """Whether it was taken now; False where it was held already. Raises LeaseTaken naming the holder."""
        if self.held:
            return False
        if self._break_it:
            self._run(f"rm -rf {self._place}")
            self._break_it = False
        owner = {**_this_process(), "what": self._what, "nonce": self._nonce}
        _of_live_runs.add(self._nonce)
        for _ in range(2):
            status, said = self._run(_TAKE.format(place=self._place, taken=TAKEN), json.dumps(owner))
            if status == 0:
                self.held = True
                return True
            if status != TAKEN:
                raise OperationError(f"{self._target.name}: no lease could be taken: {said.strip()}", "lupin doctor")
            age_text, _, holder_text = said.partition("\n")
            holder = _holder(holder_text)
            if not _is_left_over(holder):
                break
            self._run(_GIVE_BACK.format(place=self._place, nonce=holder["nonce"]))
        raise LeaseTaken(
            f"{self._target.name} is being changed by {holder['who']} ({holder['what']}) since {age_text} s; "
            "once you know that this is dead: --break-lease of lupin play"
        )

    def end(self, *, reachable: bool = True, resumed: bool = False) -> None:
        """Give it back. Behind a link that is gone it stays: its operator's next run takes it over.

        A resumed run that had nothing left to change clears away what the run before it could not give back.
        """
        _of_live_runs.discard(self._nonce)
        with contextlib.suppress(TargetError, OperationError):  # the run's own end is what is to be told
            if self.held and reachable:
                self._run(_GIVE_BACK.format(place=self._place, nonce=self._nonce))
            elif resumed and reachable:
                holder = _holder(self._run(f"cat {self._place}/owner 2>/dev/null || true")[1])
                if _is_left_over(holder):
                    self._run(_GIVE_BACK.format(place=self._place, nonce=holder["nonce"]))
        self.held = False

    def forget(self) -> None:
        """The robot was rebooted, and knows of none."""
        self.held = False

    def _run(self, script: str, owner: str = "") -> tuple[int, str]:
        output = self._target.run(script, root=True, stdin=owner.encode(), bound_s=BOUND_S)
        if output.status is None:
            raise Unreachable(f"{self._target.name} gave no lease: {output.stderr.strip()}", "lost", "lupin doctor")
        return output.status, output.stdout or output.stderr


def _this_process() -> dict[str, Any]:
    """Who this is: a name for people; machine, boot and process for telling what is left over from what lives."""
    # Containers of one machine may share its id, and number their processes each from 1.
    apart = [_read("/etc/machine-id").decode().strip(), socket.gethostname(), str(Path("/proc/self/ns/pid").readlink())]
    return {
        "who": f"{_user()}@{socket.gethostname()}",
        "uid": os.getuid(),
        "machine": hashlib.sha256("\0".join(apart).encode("utf-8", "surrogateescape")).hexdigest()[:16],
        "boot": _read("/proc/sys/kernel/random/boot_id").decode().strip(),
        "pid": os.getpid(),
        "started": _started(os.getpid()),
    }


def _holder(text: str) -> dict[str, Any]:
    unknown = {"who": "somebody", "what": "unknown"}
    try:
        return {**unknown, **json.loads(text)}
    except (ValueError, TypeError):  # no words of ours
        return unknown


def _is_left_over(holder: dict[str, Any]) -> bool:
    """Whether it is this operator's on this machine, of a process that is no more or a run of this one that has ended."""
    own = _this_process()
    if any(holder.get(key) != own[key] for key in ("machine", "uid")):
        return False
    if holder.get("boot") != own["boot"] or _started(holder.get("pid")) != holder.get("started"):
        return True
    return holder.get("pid") == own["pid"] and holder.get("nonce") not in _of_live_runs


def _started(pid: object) -> str:
    """When a process began, in ticks since the boot: a number alone may be another's by now. Empty: there is none."""
    # The second field is a name in brackets, which may hold anything; the start is the 20th behind it (proc(5)).
    fields = _read(f"/proc/{pid}/stat").rpartition(b")")[2].split()
    return fields[19].decode() if len(fields) > 19 else ""


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a number without a name; which of the two depends on Python's version
        return str(os.getuid())


def _read(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError:
        return b""
