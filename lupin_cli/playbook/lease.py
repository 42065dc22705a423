"""The lease on a robot: only one playbook run at a time changes it, and a second operator learns who holds the lease.

The lease is a folder in /run, so that a full or read-only disk does not prevent repairs and a reboot ends it. A run takes it
before its first change and gives it back at its end. A lease left by a killed run or a cut link is taken over by the next run
of the same operator; anyone else has to break it.
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

from lupin_cli.connection.base import Target, TargetError, Unreachable
from lupin_cli.operations.base import OperationError

LEASE_PATH = "/run/lupin-lease"
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
[ -f {path}/owner ] || {{ echo "{path} exists, but is not a lease" >&2; exit 1; }}
echo "$(($(cat "$new/up") - $(cat {path}/up)))"
cat {path}/owner
exit {taken}
"""
_GIVE_BACK = "if grep -qF {nonce} {path}/owner 2>/dev/null; then rm -rf {path}; fi"


class LeaseTaken(OperationError):
    """Another run holds the robot's lease."""


_live_nonces: set[str] = set()  # of the leases of this process


class Lease:
    """The right to change one robot, for one playbook run. `purpose` tells other operators what the run does."""

    def __init__(self, target: Target, purpose: str, *, break_it: bool = False, path: str = "") -> None:
        self._target, self._purpose, self._break_it, self._path = target, purpose, break_it, path or LEASE_PATH
        self._nonce = secrets.token_hex(8)
        self.held = False

    def take(self) -> bool:
        """Take the lease. Returns True if it was taken just now, False if this run already had it. Raises LeaseTaken, which
        names the holder, or OperationError."""
        if self.held:
            return False
        if self._break_it:
            self._run(f"rm -rf {self._path}")
            self._break_it = False
        owner = {**_this_process(), "what": self._purpose, "nonce": self._nonce}
        _live_nonces.add(self._nonce)
        for _ in range(2):
            status, printed = self._run(_TAKE.format(path=self._path, taken=_TAKEN), json.dumps(owner))
            if status == 0:
                self.held = True
                return True
            if status != _TAKEN:
                raise OperationError(f"{self._target.name}: the lease could not be taken: {printed.strip()}", "lupin doctor")
            age_text, _, holder_text = printed.partition("\n")
            holder = _parse_holder(holder_text)
            if not _is_stale(holder):
                break
            self._run(_GIVE_BACK.format(path=self._path, nonce=holder["nonce"]))
        raise LeaseTaken(
            f"{self._target.name} is being changed by {holder['who']} ({holder['what']}), for {age_text} s now; "
            "if you know that this run is dead, break its lease with: lupin play --break-lease"
        )

    def end(self, *, reachable: bool = True, resumed: bool = False) -> None:
        """Give the lease back. If the robot is not reachable, the lease stays there, and the operator's next run takes it over.

        A `resumed` run that had nothing left to change removes the lease that the interrupted run could not give back.
        """
        _live_nonces.discard(self._nonce)
        with contextlib.suppress(TargetError, OperationError):  # the run's own result matters more
            if self.held and reachable:
                self._run(_GIVE_BACK.format(path=self._path, nonce=self._nonce))
            elif resumed and reachable:
                holder = _parse_holder(self._run(f"cat {self._path}/owner 2>/dev/null || true")[1])
                if _is_stale(holder):
                    self._run(_GIVE_BACK.format(path=self._path, nonce=holder["nonce"]))
        self.held = False

    def forget(self) -> None:
        """Note that the robot was rebooted, which ended the lease."""
        self.held = False

    def _run(self, script: str, owner: str = "") -> tuple[int, str]:
        output = self._target.run(script, root=True, stdin=owner.encode(), timeout_s=_TIMEOUT_S)
        if output.status is None:
            raise Unreachable(
                f"{self._target.name} did not answer the request for its lease: {output.stderr.strip()}", "lost", "lupin doctor"
            )
        return output.status, output.stdout or output.stderr


def _this_process() -> dict[str, Any]:
    """Return the owner of a lease: a name for people; machine, boot and process to tell a stale lease from a live one."""
    # Containers of one machine may share its id, and each numbers its processes from 1.
    identity = [_read("/etc/machine-id").decode().strip(), socket.gethostname(), str(Path("/proc/self/ns/pid").readlink())]
    return {
        "who": f"{_user()}@{socket.gethostname()}",
        "uid": os.getuid(),
        "machine": hashlib.sha256("\0".join(identity).encode("utf-8", "surrogateescape")).hexdigest()[:16],
        "boot": _read("/proc/sys/kernel/random/boot_id").decode().strip(),
        "pid": os.getpid(),
        "started": _start_ticks(os.getpid()),
    }


def _parse_holder(text: str) -> dict[str, Any]:
    unknown = {"who": "somebody", "what": "unknown"}
    try:
        return {**unknown, **json.loads(text)}
    except (ValueError, TypeError):  # not written by Lupin
        return unknown


def _is_stale(holder: dict[str, Any]) -> bool:
    """Return whether a lease is this operator's, on this machine, and its process or its run in this process has ended."""
    own = _this_process()
    if any(holder.get(key) != own[key] for key in ("machine", "uid")):
        return False
    if holder.get("boot") != own["boot"] or _start_ticks(holder.get("pid")) != holder.get("started"):
        return True
    return holder.get("pid") == own["pid"] and holder.get("nonce") not in _live_nonces


def _start_ticks(pid: object) -> str:
    """Return the start of a process in clock ticks since boot, since PIDs are reused; empty if there is no such process."""
    # The second field is a name in parentheses, which may contain anything; the start is the 20th field after it (proc(5)).
    fields = _read(f"/proc/{pid}/stat").rpartition(b")")[2].split()
    return fields[19].decode() if len(fields) > 19 else ""


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a user id without a name; the exception depends on Python's version
        return str(os.getuid())


def _read(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError:
        return b""
