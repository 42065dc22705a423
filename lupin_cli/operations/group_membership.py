"""`group-membership`: whether a user is in a group. It counts from the next login, and for units from their next start."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import change, look, quote
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class GroupMembership:
    """The group must be there; it is the distribution's to make."""

    name: ClassVar[str] = "group-membership"
    stands: ClassVar[bool] = True

    user: str
    group: str
    member: bool = True
    machine: str = "robot"

    def differs(self, target: Target) -> Difference | None:
        script = f"getent group -- {quote(self.group)} >/dev/null || exit 41\nid -nG -- {quote(self.user)} || exit 42"
        output = look(target, script)
        if output.status == 41:
            if not self.member:
                return None
            raise OperationError(f"{target.name} has no group {self.group!r}", "getent group")
        if not output.ok:
            raise OperationError(f"{target.name} has no user {self.user!r}", "getent passwd")
        is_member = self.group in output.stdout.split()
        if is_member == self.member:
            return None
        what = "joins" if self.member else "leaves"
        return Difference(f"{self.user} {what} the group {self.group}", "", {"member": is_member})

    def change(self, target: Target, difference: Difference) -> None:
        self._set(target, self.member)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        self._set(target, bool(before["member"]))

    def _set(self, target: Target, member: bool) -> None:
        user, group = quote(self.user), quote(self.group)
        if member:
            change(target, f"usermod -aG {group} -- {user}", f"put {self.user} into {self.group}", root=True)
        else:
            script = f"id -nG -- {user} | tr ' ' '\\n' | grep -qxF -- {group} || exit 0\ngpasswd -d {user} {group}"
            change(target, script, f"take {self.user} out of {self.group}", root=True)
