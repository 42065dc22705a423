"""A lease on a robot: two operators who deploy at once would each switch the other's release."""

from __future__ import annotations

import getpass
import json
import os
import secrets
import socket
from contextlib import AbstractContextManager
from types import TracebackType

from lupin_cli.onboard import ROOT
from lupin_cli.operations.base import OperationError
from lupin_cli.target.base import Target, TargetError

# One `mkdir` decides. Uptime and boot id tell the age, since the robot's wall clock may say anything.
_TAKE = """set -eu
mkdir -p {root} && cd {root}
boot=$(cat /proc/sys/kernel/random/boot_id)
up=$(cut -d. -f1 /proc/uptime)
if [ -d lease ] && [ "$(cat lease/boot 2>/dev/null || echo none)" != "$boot" ]; then rm -rf lease; fi
if mkdir lease 2>/dev/null; then
  echo "$boot" > lease/boot; echo "$up" > lease/up; cat > lease/owner
  exit 0
fi
echo "$((up - $(cat lease/up 2>/dev/null || echo "$up")))"; cat lease/owner
exit 7
"""
_GIVE_BACK = "cd {root} && if grep -q {nonce} lease/owner 2>/dev/null; then rm -rf lease; fi"
TAKEN = 7


class Lease(AbstractContextManager["Lease"]):
    """Held while a deploy changes a robot; raises OperationError naming the holder where another one holds it."""

    def __init__(self, target: Target, *, break_it: bool = False, root: str = ROOT) -> None:
        self._target, self._root = target, root
        self._nonce = secrets.token_hex(8)
        if break_it:
            self._run(f"rm -rf {root}/lease")
        self._take()

    def _take(self) -> None:
        owner = {"who": f"{getpass.getuser()}@{socket.gethostname()}", "pid": os.getpid(), "nonce": self._nonce}
        status, said = self._run(_TAKE.format(root=self._root), json.dumps(owner))
        if status == 0:
            return
        if status != TAKEN:
            raise OperationError(f"{self._target.name}: no lease could be taken: {said.strip()}", "lupin doctor")
        age_text, _, holder_text = said.partition("\n")
        try:
            holder = json.loads(holder_text)
        except ValueError:
            holder = {}  # its taker was cut off between mkdir and the name
        if holder.get("who") == owner["who"] and not _alive(holder.get("pid")):
            self._run(f"rm -rf {self._root}/lease")  # our own, of a run that was killed
            self._take()
            return
        raise OperationError(
            f"{self._target.name} is being deployed to by {holder.get('who', 'somebody')} since {age_text} s",
            "lupin deploy robot --break-lease  (once you know that run is dead)",
        )

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            self._run(_GIVE_BACK.format(root=self._root, nonce=self._nonce))
        except TargetError:
            if error is None:
                raise  # else the link's first failure is the one to report

    def _run(self, script: str, owner: str = "") -> tuple[int | None, str]:
        output = self._target.run(script, root=True, stdin=owner.encode(), bound_s=20.0)
        return output.status, output.stdout or output.stderr


def _alive(pid: object) -> bool:
    return isinstance(pid, int) and os.path.exists(f"/proc/{pid}")  # noqa: PTH110
