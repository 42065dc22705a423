"""`network-connection`: a saved connection of NetworkManager, and what it says."""

from __future__ import annotations

import re
from dataclasses import field
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import change, look, quote
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

_PROPERTY = re.compile(r"[a-z0-9-]+\.[a-z0-9-]+\Z")
_ABSENT = 10  # nmcli(1): connection, device, or access point does not exist
_NOT_RUNNING = 8


@dataclass(frozen=True, kw_only=True)
class NetworkConnection:
    """`connection` exists and its properties are `settings`, as `nmcli` names them: connection.autoconnect-priority: "100".

    One that isn't there is made where `type` and `interface` are given. `up: true` brings it up where it isn't. Of a property
    that is a secret nothing is read: it is only written, where the connection is made.
    """

    name: ClassVar[str] = "network-connection"
    stands: ClassVar[bool] = True
    settle_s: ClassVar[float] = 15.0
    reports: ClassVar[tuple[str, ...]] = ("present",)

    connection: str
    settings: dict[str, str] = field(default_factory=dict)
    type: str = ""  # ethernet, wifi
    interface: str = ""
    up: bool | None = None
    machine: str = "laptop"

    def __post_init__(self) -> None:
        for name in self.settings:
            if not _PROPERTY.match(name):
                raise ValueError(f"a setting is named like ipv4.never-default, unlike {name!r}")

    def _read(self, target: Target) -> dict[str, str] | None:
        """The values by property, and the state; None where there is no such connection."""
        names = ["GENERAL.STATE", *(name for name in self.settings if not _secret(name))]
        lines = [
            f'printf "%s=%s\\n" {quote(n)} "$(nmcli -g {quote(n)} connection show id {quote(self.connection)})"' for n in names
        ]
        script = f"nmcli -g connection.id connection show id {quote(self.connection)} >/dev/null || exit $?\n" + "\n".join(
            lines
        )
        output = look(target, script)
        if output.status == _ABSENT:
            return None
        if not output.ok:
            if output.status == 127:
                raise OperationError(f"{target.name} has no NetworkManager (nmcli)", "ip -br address")
            reason = "NetworkManager does not run" if output.status == _NOT_RUNNING else output.stderr.strip()
            raise OperationError(f"{target.name}: {reason}", "systemctl status NetworkManager")
        return dict(line.split("=", 1) for line in output.stdout.splitlines() if "=" in line)

    def differs(self, target: Target) -> Difference | None:
        now = self._read(target)
        if now is None:
            if not (self.type and self.interface):
                raise OperationError(f"{target.name} has no saved connection {self.connection!r}", "nmcli connection show")
            return Difference(
                f"the connection {self.connection} is made",
                _lines({}, {n: v for n, v in self.settings.items() if not _secret(n)}),
                {"present": False},
            )
        wanted = {name: value for name, value in self.settings.items() if not _secret(name)}
        old = {name: now.get(name, "") for name in wanted}
        changed = {name: value for name, value in wanted.items() if not _same(old[name], value)}
        is_up = "activated" in now.get("GENERAL.STATE", "")
        wants = self.up is not None and is_up != self.up
        if not changed and not wants:
            return None
        what = [f"{name} becomes {value}" for name, value in changed.items()] + (
            ["goes up" if self.up else "goes down"] if wants else []
        )
        before = {"present": True, "settings": {name: old[name] for name in changed}, "up": is_up}
        return Difference(f"{self.connection}: {', '.join(what)}", _lines(old, wanted), before)

    def change(self, target: Target, difference: Difference) -> None:
        name = quote(self.connection)
        pairs = " ".join(f"{quote(key)} {quote(value)}" for key, value in self.settings.items())
        lines = ["set -e"]
        if not difference.before["present"]:
            lines.append(f"nmcli connection add type {quote(self.type)} ifname {quote(self.interface)} con-name {name} {pairs}")
        elif pairs:
            lines.append(f"nmcli connection modify id {name} {pairs}")
        if self.up is not None:
            lines.append(f"nmcli --wait 20 connection {'up' if self.up else 'down'} id {name}")
        change(
            target, "\n".join(lines), f"set the connection {self.connection}", root=True, next_command="nmcli connection show"
        )

    def report(self, target: Target) -> dict[str, Any]:
        return {"present": self._read(target) is not None}

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        name = quote(self.connection)
        if not before["present"]:
            script = f"nmcli connection delete id {name} || [ $? -eq {_ABSENT} ]"
            change(target, script, f"remove the connection {self.connection}", root=True)
            return
        pairs = " ".join(f"{quote(key)} {quote(value)}" for key, value in before["settings"].items())
        lines = [f"nmcli connection modify id {name} {pairs}"] if pairs else []
        if self.up is not None and before["up"] != self.up:
            lines.append(f"nmcli --wait 20 connection {'up' if before['up'] else 'down'} id {name}")
        if lines:
            change(target, "set -e\n" + "\n".join(lines), f"put the connection {self.connection} back", root=True)


def _secret(name: str) -> bool:
    return name.rpartition(".")[2] in ("psk", "password", "pin", "leap-password", "wep-key0", "private-key-password")


def _same(old: str, new: str) -> bool:
    # nmcli says yes and no, and takes true and false as well; a list may come with blanks.
    plain = {"true": "yes", "false": "no"}
    return plain.get(old, old).replace(" ", "") == plain.get(new, new).replace(" ", "")


def _lines(old: dict[str, str], new: dict[str, str]) -> str:
    lines = []
    for name, value in new.items():
        if name in old and _same(old[name], value):
            continue
        lines += ([f"-{name} {old[name]}"] if old.get(name) else []) + [f"+{name} {value}"]
    return "\n".join(lines)
