"""Where a connection goes: an address of the inventory, completed by the SSH configuration."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

from lupin_cli.connection import ssh_client
from lupin_cli.connection.base import SshConfigUnusable
from lupin_cli.connection.ssh_config_words import expand, expand_path, expand_tilde, parse_hop, tokens_of
from lupin_cli.printed_commands import ssh

_DESTINATION = re.compile(
    r"^(?:(?P<user>[^@\s]+)@)?(?P<host>\[[0-9A-Fa-f:.]+(?:%[^\]\s]+)?\]|[^@:\s]+)(?::(?P<port>\d{1,5}))?$"
)


@dataclass(frozen=True)
class Destination:
    """Everything needed to connect to an sshd; only the host name is still to be resolved."""

    host: str
    port: int = 22
    user: str = ""
    identity_files: tuple[str, ...] = ()
    identities_only: bool = False
    jumps: tuple[Destination, ...] = ()  # in the order in which they are passed
    proxy_command: str = ""
    original_host: str = ""  # as the inventory or a command line names it, before HostName replaced it
    certificate_files: tuple[str, ...] = ()
    identity_agent: str = ""  # a socket, none, SSH_AUTH_SOCK or $VARIABLE; empty is the same as SSH_AUTH_SOCK
    host_key_alias: str = ""
    user_known_hosts: tuple[str, ...] = ()
    global_known_hosts: tuple[str, ...] = ()
    revoked_host_keys: str = ""
    asks_for_host_keys: bool = True  # False: StrictHostKeyChecking yes

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.user}@{host}" + (f":{self.port}" if self.port != 22 else "")

    @property
    def with_way(self) -> str:
        """The destination and what leads to it, for people."""
        way = ", ".join(map(str, self.jumps)) or self.proxy_command
        return f"{self} through {way}" if way else str(self)

    @property
    def login_command(self) -> str:
        """What a person types to log in there; ~/.ssh/config adds what it says about the host, such as jump hosts."""
        return ssh(self.user, self.original_host or self.host, self.port)

    @property
    def known_as(self) -> str:
        """The name under which a known_hosts file stores its key."""
        if self.host_key_alias:
            return self.host_key_alias
        return self.host if self.port == 22 else f"[{self.host}]:{self.port}"


def parse_destination(text: str) -> tuple[str, str, int]:
    """Split `[user@]host[:port]` into user (or ""), host and port (or 0). Raises ValueError."""
    found = _DESTINATION.match(text)
    if found is None or int(found["port"] or 1) not in range(1, 65536):
        raise ValueError(f"expected [user@]host[:port], found {text!r}")
    return found["user"] or "", found["host"].strip("[]"), int(found["port"] or 0)


def resolve(
    host: str, user: str = "", port: int = 0, *, default_user: str = "", config_path: Path | None = None
) -> Destination:
    """Return the destination for `host`, which may be an alias of the SSH configuration. `user` and `port` override that.

    If neither names a user, it is `default_user`, or else the user who runs Lupin. `config_path` replaces the files of the user
    and of the system. Raises SshConfigUnusable for a configuration that ssh refuses.
    """
    return _resolve(host, user, port, "", default_user, config_path, ())


def _resolve(
    host: str, user: str, port: int, earlier: str, default_user: str, path: Path | None, jumping_from: tuple[str, ...]
) -> Destination:
    """Resolve `host`, to which the hops `earlier` lead; without any, its own ProxyJump or ProxyCommand does, as with ssh."""
    answer = ssh_client.resolve(host, user, port, jumps=earlier, default_user=default_user, path=path)

    def first(keyword: str) -> str:
        value = next(iter(answer.get(keyword, ())), "")
        return "" if value.lower() == "none" and keyword.startswith(("proxy", "revoked")) else value

    home = Path(os.environ.get("HOME") or Path.home())
    found = Destination(
        host=first("hostname"),
        port=int(first("port") or 22),
        user=first("user"),
        identities_only=first("identitiesonly") == "yes",
        original_host=host,
        host_key_alias=first("hostkeyalias"),
        identity_agent=first("identityagent"),
        user_known_hosts=_files(answer, "userknownhostsfile", home),
        global_known_hosts=_files(answer, "globalknownhostsfile", home),
        revoked_host_keys=first("revokedhostkeys") and expand_tilde(first("revokedhostkeys"), home),
        asks_for_host_keys=first("stricthostkeychecking") not in ("yes", "true"),
    )
    tokens = tokens_of(found.host, host, found.user, found.port, found.host_key_alias, home)
    try:
        str(found).encode()  # raises for bytes that are not UTF-8
        identities, certificates = (
            tuple(expand_path(each, tokens, home) for each in answer.get(keyword, ()) if each.lower() != "none")
            for keyword in ("identityfile", "certificatefile")
        )
        found = replace(found, identity_files=identities, certificate_files=certificates)
        if earlier:
            return found
        if not (jump := first("proxyjump")):
            return replace(found, proxy_command=expand(first("proxycommand"), tokens))
        if host in jumping_from:
            circle = " -> ".join([*jumping_from, host])
            raise SshConfigUnusable(f"the SSH configuration jumps in a circle: {circle}", f"ssh -G {host}")
        hops = expand(jump, tokens).split(",")
        parsed = [parse_hop(hop) for hop in hops]
    except ValueError as error:
        raise SshConfigUnusable(f"{host} cannot be resolved: {error}", f"ssh -G {host}") from error
    jumps: tuple[Destination, ...] = ()
    for number, (hop_user, hop_host, hop_port) in enumerate(parsed):
        through = ",".join(hops[:number])
        hop = _resolve(hop_host, hop_user, hop_port, through, "", path, (*jumping_from, host))
        jumps += (*hop.jumps, replace(hop, jumps=()))
    return replace(found, jumps=jumps)


def _files(answer: ssh_client.Answer, keyword: str, home: Path) -> tuple[str, ...]:
    return tuple(expand_tilde(each, home) for each in answer.get(keyword, ()) if each.lower() != "none")
