"""`group-membership`: whether a user is in a group. It takes effect at the next login, and for units at their next start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change, quote, text_of

_NO_GROUP, _NO_USER = 41, 42


@dataclass(frozen=True, kw_only=True)
class GroupMembership(Operation):
    """The group must exist; the distribution creates it."""

    name: ClassVar[str] = "group-membership"
    effect: ClassVar[str] = "a user is in a group, or is not"
    undo_effect: ClassVar[str] = "yes"
    prefetchable: ClassVar[bool] = True

    user: str
    group: str
    member: bool = True

    def probe(self) -> Script:
        group, user = quote(self.group), quote(self.user)
        return probe_script(f"getent group -- {group} >/dev/null || exit {_NO_GROUP}\nid -nG -- {user} || exit {_NO_USER}")

    def judge(self, output: Output) -> Difference | None:
        if output.status == _NO_GROUP:
            if not self.member:
                return None
            raise OperationError(f"the {self.machine} has no group {self.group!r}", "getent group")
        if output.status == _NO_USER:
            raise OperationError(f"the {self.machine} has no user {self.user!r}", "getent passwd")
        is_member = self.group in text_of(output, f"the groups of {self.user}").split()
        if is_member == self.member:
            return None
        summary = (
            f"add {self.user} to the group {self.group}" if self.member else f"remove {self.user} from the group {self.group}"
        )
        return Difference(summary, "", {"member": is_member})

    def change(self, target: Target, difference: Difference) -> None:
        self._set(target, self.member)

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        self._set(target, bool(before["member"]))

    def _set(self, target: Target, member: bool) -> None:
        user, group = quote(self.user), quote(self.group)
        if member:
            change(target, f"usermod -aG {group} -- {user}", f"add {self.user} to {self.group}", root=True)
        else:
            script = f"id -nG -- {user} | tr ' ' '\\n' | grep -qxF -- {group} || exit 0\ngpasswd -d {user} {group}"
            change(target, script, f"remove {self.user} from {self.group}", root=True)
