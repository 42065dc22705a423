"""`network-connection`: a saved connection of NetworkManager and its settings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change, key_values, quote

_PROPERTY = re.compile(r"[a-z0-9-]+\.[a-z0-9-]+\Z")
_ABSENT = 10  # nmcli(1): connection, device, or access point does not exist
_NOT_RUNNING = 8
_NO_NMCLI = 127
_STATE = "GENERAL.STATE"
_AUTOCONNECT = "connection.autoconnect"
_SECRET = re.compile(r"(?:psk|password|pin|wep-key[0-3])\Z")
# Every user can read the arguments of a process, so nmcli's editor gets a secret on standard input; printf and [ are the
# shell's own. The editor exits with 0 whatever happens, and prints the secret.
_SAVE = r"""secret={value}
printf 'set %s %s\nsave persistent\nquit\n' {key} "$secret" | nmcli connection edit id {name} >/dev/null 2>&1 || :
[ "$(nmcli --escape no --show-secrets -g {key} connection show id {name})" = "$secret" ] ||
  {{ echo 'NetworkManager did not save '{key}'; is the value valid?' >&2; exit 1; }}"""


@dataclass(frozen=True, kw_only=True)
class NetworkConnection(Operation):
    """`connection` exists and has these `settings`, named as in nmcli: connection.autoconnect-priority: "100".

    A connection that does not exist is created if `type` and `interface` are given. `up` activates or deactivates it. Secret
    settings are never read; every change writes them.
    """

    name: ClassVar[str] = "network-connection"
    effect: ClassVar[str] = "a saved connection of NetworkManager has these settings, and is up or down"
    undo_effect: ClassVar[str] = "yes; secrets are never read"
    prefetchable: ClassVar[bool] = True
    settle_s: ClassVar[float] = 15.0
    report_keys: ClassVar[tuple[str, ...]] = ("present",)

    machine: str = "laptop"
    connection: str
    settings: dict[str, str] = field(default_factory=dict)
    type: str = ""  # ethernet, wifi
    interface: str = ""
    up: bool | None = None

    def __post_init__(self) -> None:
        for name, value in self.settings.items():
            if not _PROPERTY.match(name):
                raise ValueError(f"a setting must be named like ipv4.never-default: {name!r}")
            if _is_secret(name) and (value.strip() != value or len(value.splitlines()) > 1):
                raise ValueError(f"{name} must be one line, without blanks at its ends")  # nmcli's editor reads it as a line

    def _readable(self) -> dict[str, str]:
        return {name: value for name, value in self.settings.items() if not _is_secret(name)}

    def probe(self) -> Script:
        connection = quote(self.connection)
        lines = [f"nmcli -g connection.id connection show id {connection} >/dev/null || exit $?"]
        for name in map(quote, [_STATE, *self._readable()]):
            lines.append(f'printf "%s=%s\\n" {name} "$(nmcli -g {name} connection show id {connection})"')
        return probe_script("\n".join(lines))

    def _values(self, output: Output) -> dict[str, str] | None:
        """Return the current values by setting, and the state; None if there is no such connection."""
        if output.status == _ABSENT:
            return None
        if output.status == _NO_NMCLI:
            raise OperationError(f"the {self.machine} has no NetworkManager (nmcli)", "ip -br address")
        if output.status == _NOT_RUNNING:
            raise OperationError(f"NetworkManager does not run on the {self.machine}", "systemctl status NetworkManager")
        values = key_values(output, f"the connection {self.connection}")
        if missing := {_STATE, *self._readable()} - values.keys():
            raise OperationError(f"could not read {', '.join(sorted(missing))} of {self.connection}", "nmcli connection show")
        return values

    def judge(self, output: Output) -> Difference | None:
        values, wanted = self._values(output), self._readable()
        if values is None:
            if not (self.type and self.interface):
                raise OperationError(f"the {self.machine} has no saved connection {self.connection!r}", "nmcli connection show")
            return Difference(f"create the connection {self.connection}", _diff({}, wanted), {"present": False})
        old = {name: values[name] for name in wanted}
        changed = {name: value for name, value in wanted.items() if not _is_same(old[name], value)}
        is_up = "activated" in values[_STATE]
        must_switch = self.up is not None and is_up != self.up
        if not changed and not must_switch:
            return None
        changes = [f"{name} = {value}" for name, value in changed.items()]
        if must_switch:
            changes.append("bring it up" if self.up else "take it down")
        before = {"present": True, "settings": {name: old[name] for name in changed}, "up": is_up}
        return Difference(f"change the connection {self.connection}: {', '.join(changes)}", _diff(old, wanted), before)

    def change(self, target: Target, difference: Difference) -> None:
        name = quote(self.connection)
        readable, secrets = self._readable(), {key: self.settings[key] for key in self.settings if _is_secret(key)}
        pairs = " ".join(f"{quote(key)} {quote(value)}" for key, value in readable.items())
        lines = ["set -e"]
        if not difference.before["present"]:
            # Without its secrets it must not be brought up yet.
            waits = f" {_AUTOCONNECT} no" if secrets else ""
            lines.append(
                f"nmcli connection add type {quote(self.type)} ifname {quote(self.interface)} con-name {name} {pairs}{waits}"
            )
        elif pairs:
            lines.append(f"nmcli connection modify id {name} {pairs}")
        for key, value in secrets.items():
            lines.append(_SAVE.format(name=name, key=quote(key), value=quote(value)))
        if secrets and not difference.before["present"]:
            wanted = readable.get(_AUTOCONNECT, "yes")
            lines.append(f"nmcli connection modify id {name} {_AUTOCONNECT} {quote(wanted)}")
        if self.up is not None:
            lines.append(f"nmcli --wait 20 connection {'up' if self.up else 'down'} id {name}")
        change(
            target, "\n".join(lines), f"set the connection {self.connection}", root=True, next_command="nmcli connection show"
        )

    def report(self, output: Output) -> dict[str, Any]:
        return {"present": self._values(output) is not None}

    def overwritten(self, output: Output) -> dict[str, bytes]:
        """Return the settings, without those that are never read, and without whether the connection is up."""
        values = self._values(output)
        settings = values and sorted((name, _canonical(value)) for name, value in values.items() if name != _STATE)
        return {f"the connection {self.connection}": str(settings).encode()}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
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
            change(target, "set -e\n" + "\n".join(lines), f"restore the connection {self.connection}", root=True)


def _is_secret(name: str) -> bool:
    return _SECRET.search(name) is not None


def _is_same(old: str, new: str) -> bool:
    return _canonical(old) == _canonical(new)


def _canonical(value: str) -> str:
    # nmcli prints yes and no, and accepts true and false too; a list may contain blanks.
    return {"true": "yes", "false": "no"}.get(value, value).replace(" ", "")


def _diff(old: dict[str, str], new: dict[str, str]) -> str:
    lines = []
    for name, value in new.items():
        if name in old and _is_same(old[name], value):
            continue
        lines += ([f"-{name} {old[name]}"] if old.get(name) else []) + [f"+{name} {value}"]
    return "\n".join(lines)
