"""ssh_config(5) as OpenSSH 9 reads it: the files that it includes, and what it says of one host.

The `ssh` client resolves the configuration wherever it is installed (`ssh_client`); `read` is for machines without it. It gives
the same answer, or raises: it checks the options in `_STRINGS`, `_LISTS` and the like, and takes every other one as valid.
"""

from __future__ import annotations

import getpass
import glob
import os
import re
import socket
import stat
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lupin_cli.connection.ssh_config_words import (
    BLANKS,
    ConfigError,
    expand,
    expand_path,
    expand_tilde,
    matches,
    matches_list,
    parse_hop,
    parse_port,
    split_arguments,
    split_line,
    split_word,
    tokens_of,
)
from lupin_runtime.bounded_file import read_bounded_text

SYSTEM_CONFIG = Path("/etc/ssh/ssh_config")
EXEC_TIMEOUT_S = 5.0  # of one Match exec
MAX_DEPTH = 16  # of includes, as in OpenSSH
MAX_LINES = 20_000  # with all includes, which may multiply
MAX_IDENTITIES = 100
DEFAULT_USER_KNOWN_HOSTS = ("~/.ssh/known_hosts", "~/.ssh/known_hosts2")
DEFAULT_GLOBAL_KNOWN_HOSTS = ("/etc/ssh/ssh_known_hosts", "/etc/ssh/ssh_known_hosts2")

_CRITERIA = ("host", "originalhost", "user", "localuser", "exec")
_FLAGS = {"yes": "yes", "true": "yes", "no": "no", "false": "no"}
_CANONICALIZE = {**_FLAGS, "always": "always"}
_STRICT = {**_FLAGS, "off": "no", "ask": "ask", "accept-new": "accept-new"}
_STRINGS = ("user", "hostname", "hostkeyalias", "identityagent", "revokedhostkeys")
_MULTIPLE: Mapping[str, Mapping[str, str]] = {
    "identitiesonly": _FLAGS,
    "canonicalizefallbacklocal": _FLAGS,
    "canonicalizehostname": _CANONICALIZE,
    "stricthostkeychecking": _STRICT,
}
_LISTS = ("userknownhostsfile", "globalknownhostsfile", "canonicaldomains")
_IDENTITIES = {"identityfile": "identityfile", "identityfile2": "identityfile", "certificatefile": "certificatefile"}
# Every other option of OpenSSH 9.2. Those of later releases are left out by an older client too, and named.
_OTHERS = frozenset(
    re.findall(
        r"\w+",
        """
        addkeystoagent addressfamily afstokenpassing batchmode bindaddress bindinterface canonicalizemaxdots
        canonicalizepermittedcnames casignaturealgorithms challengeresponseauthentication checkhostip cipher ciphers
        clearallforwardings compression compressionlevel connectionattempts connecttimeout controlmaster controlpath
        controlpersist dsaauthentication dynamicforward enableescapecommandline enablesshkeysign escapechar
        exitonforwardfailure fallbacktorsh fingerprinthash forkafterauthentication forwardagent forwardx11
        forwardx11timeout forwardx11trusted gatewayports globalknownhostsfile2 gssapiauthentication
        gssapidelegatecredentials hashknownhosts hostbasedacceptedalgorithms hostbasedauthentication hostbasedkeytypes
        hostkeyalgorithms ipqos kbdinteractiveauthentication kbdinteractivedevices keepalive kerberosauthentication
        kerberostgtpassing kexalgorithms knownhostscommand localcommand localforward loglevel logverbose macs
        nohostauthenticationforlocalhost numberofpasswordprompts passwordauthentication permitlocalcommand
        permitremoteopen pkcs11provider preferredauthentications protocol proxyusefdpass pubkeyacceptedalgorithms
        pubkeyacceptedkeytypes pubkeyauthentication rekeylimit remotecommand remoteforward requesttty requiredrsasize
        rhostsauthentication rhostsrsaauthentication rsaauthentication securitykeyprovider sendenv serveralivecountmax
        serveraliveinterval sessiontype setenv skeyauthentication smartcarddevice stdinnull streamlocalbindmask
        streamlocalbindunlink syslogfacility tcpkeepalive tisauthentication tunnel tunneldevice updatehostkeys
        useprivilegedport userknownhostsfile2 useroaming usersh verifyhostkeydns visualhostkey xauthlocation
        gssapikeyexchange gssapiclientidentity gssapiserveridentity gssapirenewalforcesrekey gssapitrustdns
        gssapikexalgorithms
        """,
    )
)
# They change nothing that Lupin does, so an older client, which refuses the whole file for them, need not stop it.
NEWER_OPTIONS = frozenset(("channeltimeout", "obscurekeystroketiming", "tag", "versionaddendum", "warnweakcrypto"))

Notice = Callable[[str], None]  # says once what was left out


class NeedsClient(ConfigError):
    """What only ssh itself can apply."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} needs the ssh client; install it: apt install openssh-client")


def included(argument: str, folder: Path, home: Path) -> list[Path]:
    """Return the files that an argument of Include stands for, in their order; `folder` is that of relative ones."""
    path = expand_tilde(argument, home)
    try:
        return [Path(name) for name in sorted(glob.glob(path if path.startswith("/") else f"{folder}/{path}"))]  # noqa: PTH207 -- the pattern is absolute
    except ValueError:  # NUL
        return []


def read_config_file(path: Path, *, checked: bool) -> str | None:
    """Return the text of a configuration file; None for what is no file, which ssh reads as empty or waits for.

    `checked`: only its owner, who is this user or root, may write to it. Raises ConfigError, also for what cannot be read.
    """
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be read: {error}") from error
    if not stat.S_ISREG(status.st_mode):
        return None
    if checked and (status.st_uid not in (0, os.getuid()) or status.st_mode & 0o022):
        raise ConfigError(f"{path} belongs to another user, or others may write to it; correct it with: chmod go-w {path}")
    try:
        text = read_bounded_text(path, errors="surrogateescape")
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from error
    return text.removeprefix("\ufeff")


@dataclass
class _Pass:
    """What has been read for one host, first on the first pass over the files, then perhaps on a second one."""

    original_host: str
    host: str  # on a second pass, the one that HostName gave
    home: Path
    notice: Notice
    found: dict[str, list[str]] = field(default_factory=dict)
    is_final: bool = False
    wants_final: bool = False
    ignored: str = ""  # IgnoreUnknown
    lines: int = 0

    def set(self, keyword: str, *values: str) -> None:
        """Keep the first value of an option."""
        self.found.setdefault(keyword, list(values))

    def first(self, keyword: str, default: str = "") -> str:
        return next(iter(self.found.get(keyword, ())), default)

    def read_file(
        self, path: Path, folder: Path, *, checked: bool, active: bool = True, never: bool = False, depth: int = 0
    ) -> None:
        """Read one file with its includes; `never`: for its syntax only. Raises ConfigError."""
        if depth > MAX_DEPTH:
            raise ConfigError(f"{path}: too many recursive includes")
        text = read_config_file(path, checked=checked)
        for number, line in enumerate((text or "").split("\n"), 1):
            self.lines += 1
            if self.lines > MAX_LINES:
                raise ConfigError(f"{path}:{number}: more than {MAX_LINES} lines with all includes")
            keyword, rest = split_line(line)
            if not keyword:
                continue
            try:
                if not rest:
                    raise ValueError(f'no argument after keyword "{keyword}"')
                arguments = split_arguments(rest)
                if keyword == "host":
                    active = not never and self._is_named(arguments)
                elif keyword == "match":
                    active = self._satisfies(rest, f"{path}:{number}") and not never
                elif keyword == "include":
                    for argument in self._non_empty(arguments):
                        for each in included(argument, folder, self.home):
                            self.read_file(
                                each, folder, checked=True, active=active, never=never or not active, depth=depth + 1
                            )
                else:
                    self._apply(keyword, rest, arguments, active, f"{path}:{number}")
            except ConfigError:
                raise
            except ValueError as error:
                raise ConfigError(f"{path}:{number}: {error}") from error

    @staticmethod
    def _non_empty(arguments: Sequence[str]) -> Iterator[str]:
        for argument in arguments:
            if not argument:
                raise ValueError("empty argument")
            yield argument

    def _is_named(self, patterns: Sequence[str]) -> bool:
        named = False
        for pattern in self._non_empty(patterns):
            if matches(pattern.removeprefix("!"), self.host):
                if pattern.startswith("!"):
                    return False
                named = True
        return named

    def _satisfies(self, rest: str, where: str) -> bool:
        """Return whether all criteria of a Match line hold. One that is not known never does, also if it is negated."""
        result, count = True, 0
        current: str | None = rest
        while True:
            word, current = split_word(current)
            if not word or word.startswith("#"):
                break
            name, is_negated = word.removeprefix("!").lower(), word.startswith("!")
            if name == "all":
                following = split_word(current)[0]
                if count > 1 or (following and not following.startswith("#")):
                    raise ValueError(f"'{word}' cannot be combined with other Match attributes")
                return result and not is_negated
            count += 1
            if name in ("canonical", "final"):
                self.wants_final = self.wants_final or name == "final"
                result = result and self.is_final is not is_negated
                continue
            argument, current = split_word(current)
            if not argument or argument.startswith("#"):
                raise ValueError(f"Missing Match criteria for {name}")
            if name not in _CRITERIA:
                self.notice(f"{where}: the Match criterion {name} is not known here; the block is left out")
                return False
            if name == "exec":
                command = expand(argument, self._tokens())
                result = result and self._exec(command, where) is not is_negated
            else:
                result = result and self._fits(name, argument) is not is_negated
        if count == 0:
            raise ValueError("One or more attributes required for Match")
        return result

    def _fits(self, criterion: str, patterns: str) -> bool:
        if criterion == "host":
            return matches_list(patterns, self._current_host().lower(), lower=True)
        if criterion == "originalhost":
            return matches_list(patterns, self.original_host.lower(), lower=True)
        return matches_list(patterns, self.first("user", getpass.getuser()) if criterion == "user" else getpass.getuser())

    def _current_host(self) -> str:
        hostname = self.first("hostname")
        return hostname if self.is_final else expand(hostname, {"h": self.host}) if hostname else self.host

    def _tokens(self) -> dict[str, str]:
        host, user = self._current_host(), self.first("user", getpass.getuser())
        return tokens_of(
            host, self.original_host, user, int(self.first("port", "22")), self.first("hostkeyalias", host), self.home
        )

    def _exec(self, command: str, where: str) -> bool:
        shell = os.environ.get("SHELL") or "/bin/sh"
        done = run_bounded([shell, "-c", f"exec {command}"], EXEC_TIMEOUT_S)
        if done is None:
            raise ConfigError(f"{where}: Match exec {command!r} did not end within {EXEC_TIMEOUT_S:g} s")
        return done.returncode == 0

    def _apply(self, keyword: str, rest: str, arguments: list[str], active: bool, where: str) -> None:
        """Take the value of an option. Raises ValueError for one that ssh refuses."""
        if keyword == "proxyjump":
            self._jump(rest.lstrip(BLANKS + "="), active)
        elif keyword == "proxycommand":
            if active and "proxyjump" not in self.found:
                self.set(keyword, rest.lstrip(BLANKS + "="))
        elif keyword in _IDENTITIES:
            values = self.found.setdefault(_IDENTITIES[keyword], []) if active else []
            if (value := self._only(arguments)) not in values:
                values.append(value)
            if len(values) > MAX_IDENTITIES:
                raise ValueError("Too many identity files specified")
        elif keyword in _LISTS:
            values = list(self._non_empty(arguments))
            if len(values) > 1 and "none" in (each.lower() for each in values):
                raise ValueError(f'keyword {keyword} "none" argument must appear alone.')
            if active and values:
                self.set(keyword, *values)
        elif keyword in _STRINGS:
            value = self._only(arguments)
            if active:
                self.set(keyword, value)
        elif keyword == "port":
            value = self._only(arguments)
            if not (port := parse_port(value)):
                raise ValueError(f"Bad port '{value}'.")
            if active:
                self.set(keyword, str(port))
        elif keyword in _MULTIPLE:
            value = self._only(arguments).lower()
            if value not in _MULTIPLE[keyword]:
                raise ValueError(f'unsupported option "{value}".')
            if active:
                self.set(keyword, _MULTIPLE[keyword][value])
        elif keyword == "ignoreunknown":
            value = self._only(arguments)
            if active and not self.ignored:
                self.ignored = value
        elif keyword in NEWER_OPTIONS or keyword in _OTHERS:
            if rest.startswith("="):
                raise NeedsClient(f"{where}: the value {rest!r} of {keyword}")
        elif not self.ignored or not matches_list(self.ignored, keyword, lower=True):
            raise ValueError(f"Bad configuration option: {keyword}")

    @staticmethod
    def _only(arguments: list[str]) -> str:
        if not arguments or not arguments[0]:
            raise ValueError("Missing argument.")
        if len(arguments) > 1:
            raise ValueError("extra arguments at end of line")
        return arguments[0]

    def _jump(self, text: str, active: bool) -> None:
        is_none = text.lower() == "none"
        if not is_none:
            for hop in text.partition("#")[0].rstrip().split(","):
                parse_hop(hop)
        if active and "proxycommand" not in self.found:
            self.set("proxyjump", "none" if is_none else text.partition("#")[0].rstrip())


def read(
    host: str, user: str, port: int, path: Path, system: Path | None, home: Path, notice: Notice, *, default_user: str = ""
) -> dict[str, list[str]]:
    """Return what the user's file `path` and then that of the system say of `host`, with keywords and values as in `ssh -G`.

    Raises ConfigError for what ssh refuses, and for what only ssh can do: CanonicalDomains are looked up in DNS.
    """
    state = _Pass(host, host, home, notice)
    if user:
        state.set("user", user)
    if port:
        state.set("port", str(port))

    def read_files() -> None:
        state.read_file(path, path.parent, checked=system is not None)
        if system is not None:
            state.read_file(system, system.parent, checked=False)

    read_files()
    name = state._current_host()
    try:
        numeric = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST)[0][4]
        canonical = str(socket.getnameinfo(numeric, socket.NI_NUMERICHOST)[0])
        name = name if canonical.lower() == name.lower() else canonical
        is_address = True
    except (OSError, UnicodeError):
        is_address = ":" in name or "%" in name
        name = name if is_address else name.lower()
    canonicalize = state.first("canonicalizehostname", "no")
    if canonicalize != "no" and not is_address:
        if state.first("canonicaldomains", "none").lower() != "none":
            raise NeedsClient(f"{path}: CanonicalDomains")
        if state.first("canonicalizefallbacklocal", "yes") == "no" and name.count(".") <= 1:
            raise ConfigError(f"{path}: CanonicalizeFallbackLocal is no, and {name} has no address")
    if state.wants_final or canonicalize != "no":
        state.found["hostname"], state.host, state.is_final = [name], name, True
        read_files()
    state.found["hostname"] = [name]
    state.set("user", default_user or getpass.getuser())
    for keyword in ("proxyjump", "proxycommand"):
        if state.first(keyword) == "none" or (keyword == "proxycommand" and state.first(keyword).lower() == "none"):
            del state.found[keyword]
    if alias := state.first("hostkeyalias"):
        state.found["hostkeyalias"] = [alias.lower()]
    state.set("port", "22")
    if jump := state.first("proxyjump"):
        hop_user, hop, hop_port = parse_hop(jump.rpartition(",")[2])
        if (hop, hop_port or 22, hop_user or state.first("user")) == (name, int(state.first("port")), state.first("user")):
            raise ConfigError(f"jumphost loop via {hop}")
    tokens = tokens_of(name, host, state.first("user"), int(state.first("port")), alias.lower(), home)
    state.set("userknownhostsfile", *DEFAULT_USER_KNOWN_HOSTS)
    for keyword in ("userknownhostsfile", "identityagent"):
        if keyword in state.found:
            state.found[keyword] = [
                each if each.lower() == "none" else expand_path(each, tokens, home) for each in state.found[keyword]
            ]
    state.set("globalknownhostsfile", *DEFAULT_GLOBAL_KNOWN_HOSTS)
    return state.found


def run_bounded(command: Sequence[str], timeout_s: float) -> subprocess.CompletedProcess[str] | None:
    """Run a program without input, and kill all that it started at the timeout; None then. Raises OSError."""
    import signal

    null, pipe = subprocess.DEVNULL, subprocess.PIPE
    process = subprocess.Popen(command, stdin=null, stdout=pipe, stderr=pipe, start_new_session=True)
    try:
        out, err = process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return None
    decoded = (each.decode("utf-8", "surrogateescape") for each in (out, err))
    return subprocess.CompletedProcess(list(command), process.returncode, *decoded)
