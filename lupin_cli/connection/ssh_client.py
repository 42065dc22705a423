"""What OpenSSH itself says of a host: `ssh -G` reads the configuration, by its own rules, in 5 to 10 ms.

In three cases ssh reads copies of the files, in which each line keeps its number: `ssh` takes the home folder from the
password file, Lupin from $HOME; a host without a User has the robot's default user, not the name of this one; and lines of a
later OpenSSH, for which an older client refuses everything, are left out and named.
"""

from __future__ import annotations

import contextlib
import functools
import getpass
import os
import pwd
import re
import shlex
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lupin_cli.connection import ssh_config
from lupin_cli.connection.base import SshConfigUnusable
from lupin_cli.connection.ssh_config_words import ConfigError, expand_tilde, split_arguments, split_line, split_word
from lupin_cli.terminal import echo

TIMEOUT_S = 6.0  # of one `ssh -G`; a Match exec may run any program
KEPT_S = 30.0  # for how long an answer holds: the network, on which a Match exec depends, may change
MAX_CAUSE = 300  # characters of a complaint: a binary file has long ones
MAX_FILES = 500  # of a configuration, with its includes

Answer = Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class _Question:
    host: str
    user: str
    port: int
    jumps: str  # hops on the way to this one, which override its own
    default_user: str
    file: Path
    with_system: bool
    home: Path

    @property
    def next_command(self) -> str:
        """What shows the answer, or the refusal, of ssh."""
        option = "" if self.with_system and _is_home_of_ssh(self.home) else f"-F {shlex.quote(str(self.file))} "
        return f"ssh {option}-G {shlex.quote(self.host)}"

    def refused(self, cause: str) -> SshConfigUnusable:
        return SshConfigUnusable(f"{self.host} cannot be resolved: {cause}", self.next_command)


def resolve(
    host: str, user: str = "", port: int = 0, *, jumps: str = "", default_user: str = "", path: Path | None = None
) -> Answer:
    """Return the options for `host` by keyword, as `ssh -G` prints them. `user`, `port` and `jumps` override the files.

    `path` replaces the user's file and that of the system. An answer, also a refusal, is kept for at most `KEPT_S`, unless that
    file changes. Raises SshConfigUnusable.
    """
    home = Path(os.environ.get("HOME") or Path.home())
    file = home / ".ssh/config" if path is None else path
    stamp = None
    with contextlib.suppress(OSError, ValueError):
        status = file.stat()
        stamp = (status.st_mtime_ns, status.st_size)
    question = _Question(host, user, port, jumps, default_user or getpass.getuser(), file, path is None, home)
    answer = _answer(question, (stamp, time.monotonic() // KEPT_S), shutil.which("ssh"))
    if isinstance(answer, str):
        raise question.refused(answer)
    return answer


@functools.lru_cache(maxsize=256)
def _answer(question: _Question, _stamp: object, ssh: str | None) -> Answer | str:
    """Return the answer, or why there is none."""
    try:
        if ssh is not None:
            with contextlib.suppress(_NoClient):
                return _ask(question, ssh)
        if question.file.exists() or ssh_config.SYSTEM_CONFIG.exists():
            install = "ssh is not installed" if ssh is None else f"{ssh} cannot resolve it (it has no option -G, or no user)"
            _say_once(f"Lupin reads the SSH configuration itself: {install}; apt install openssh-client")
        system = ssh_config.SYSTEM_CONFIG if question.with_system else None
        return ssh_config.read(
            *(question.host, question.user, question.port, question.file, system, question.home, _say_once),
            default_user=question.default_user,
        )
    except (ValueError, OSError) as error:  # ConfigError; a NUL in the name of a host
        return str(error)


class _NoClient(Exception):
    """The program `ssh` is another one than OpenSSH's, or does not run for this user."""


def _ask(question: _Question, ssh: str) -> Answer:
    """Ask ssh, with the files themselves if it reads the same; else, or if it refuses them, with copies. Raises ConfigError."""
    user = ["-l", question.user] if question.user else []
    port = ["-p", str(question.port)] if question.port else []
    jumps = ["-J", question.jumps] if question.jumps else []
    words = [*user, *port, *jumps, "--", question.host]
    answer: dict[str, list[str]] = {}
    if question.with_system and _is_home_of_ssh(question.home):
        answer = _parse(_run([ssh, "-G", *words])[0] or "")
    answer = answer or _ask_copies(question, ssh, words, "")
    if question.user or answer["user"] != [getpass.getuser()] or question.default_user == getpass.getuser():
        return answer
    return _ask_copies(question, ssh, words, question.default_user)  # it may be that no file names a user


def _ask_copies(question: _Question, ssh: str, words: Sequence[str], default_user: str) -> dict[str, list[str]]:
    left_out: set[str] = set()
    while True:
        with tempfile.TemporaryDirectory(prefix="lupin-ssh-") as folder:
            copies = _Copies(Path(folder), question, left_out)
            printed, complaint = _run([ssh, "-G", "-F", str(copies.write_top(default_user)), *words])
            cause = copies.original(_cause(complaint))
        if answer := _parse(printed or ""):
            return _with_home(answer, question.home)
        if printed is None:
            raise ConfigError(
                f"{question.file}: ssh -G did not answer within {TIMEOUT_S:g} s; a Match exec may wait for something"
            )
        newer = set(re.findall(r"Unsupported Match attribute (\S+)", complaint))
        newer |= {*re.findall(r"Bad configuration option: (\S+)", complaint)} & ssh_config.NEWER_OPTIONS
        if not newer - left_out:
            if re.search(r"(unknown|illegal|invalid|unrecognized) option|No user exists", complaint):
                raise _NoClient
            raise ConfigError(cause if cause.startswith("/") else f"{question.file}: {cause}")
        left_out |= newer


def _with_home(answer: dict[str, list[str]], home: Path) -> dict[str, list[str]]:
    """Return the answer with the default known_hosts files below `home`, where ssh takes those of the password file."""
    defaults = ssh_config.DEFAULT_USER_KNOWN_HOSTS
    of_ssh = [expand_tilde(each, Path(pwd.getpwuid(os.getuid()).pw_dir)) for each in defaults]
    if answer["userknownhostsfile"] == of_ssh:
        answer["userknownhostsfile"] = [expand_tilde(each, home) for each in defaults]
    return answer


def _is_home_of_ssh(home: Path) -> bool:
    try:
        return os.path.realpath(pwd.getpwuid(os.getuid()).pw_dir) == os.path.realpath(home)
    except KeyError:  # no such user, as in some containers: ssh refuses to run
        return False


def _run(command: Sequence[str]) -> tuple[str | None, str]:
    """Return what ssh prints on its two streams: the first is None if it did not end in time, and empty if it refused."""
    done = ssh_config.run_bounded(command, TIMEOUT_S)
    if done is None:
        return None, ""
    return (done.stdout if done.returncode == 0 else ""), done.stderr


def _parse(printed: str) -> dict[str, list[str]]:
    answer: dict[str, list[str]] = {}
    for line in printed.split("\n"):
        keyword, _, value = line.partition(" ")
        if value:
            answer.setdefault(keyword, []).append(value)
    for keyword in ("userknownhostsfile", "globalknownhostsfile"):
        answer[keyword] = _split_paths(*answer.get(keyword, ["none"]))
    return answer if "hostname" in answer else {}


def _split_paths(text: str) -> list[str]:
    """Split paths that ssh prints without quotation marks: a blank belongs to a path if there is such a file."""
    words, paths = text.split(" "), []
    while words:
        count = next((n for n in range(len(words), 1, -1) if Path(" ".join(words[:n])).exists()), 1)
        paths.append(" ".join(words[:count]))
        del words[:count]
    return paths


def _cause(complaint: str) -> str:
    """Return the first thing of which ssh complains, in one line, as FILE:LINE: CAUSE."""
    lines = [line.strip() for line in complaint.splitlines()]
    causes = [line for line in lines if line and "terminating, " not in line and not line.startswith("Pseudo-terminal")]
    located = [re.sub(r"^(\S.*?):? line (\d+): ", r"\1:\2: ", line) for line in causes]
    places = [index for index, line in enumerate(located) if re.match(r".*?:\d+: ", line)]
    first = places[0] if places else len(located) - 1
    words = [located[first], *located[:first]] if located else ["ssh -G ends without an answer"]  # the place before its reason
    text = "; ".join(dict.fromkeys(words))
    more = f", and {len(places) - 1} more" if len(places) > 1 else ""
    return (text if len(text) <= MAX_CAUSE else f"{text[:MAX_CAUSE]} ...") + more


class _Copies:
    """Copies of the configuration files: paths below $HOME instead of ~, and without lines that this ssh does not know."""

    def __init__(self, folder: Path, question: _Question, left_out: set[str]) -> None:
        self._folder, self._question, self._left_out = folder, question, left_out
        self._names: dict[Path, Path] = {}

    def write_top(self, default_user: str) -> Path:
        """Write the file for `ssh -F`: the user's, the system's, then the user of hosts without one. Raises ConfigError."""
        question = self._question
        lines = [f"Include {self._copy(question.file, question.file.parent, checked=question.with_system)}"]
        if question.with_system:
            lines.append(f"Include {self._copy(ssh_config.SYSTEM_CONFIG, ssh_config.SYSTEM_CONFIG.parent, checked=False)}")
        if default_user:
            lines += ["Host *", f"User {_quoted(default_user)}"]
        top = self._folder / "top"
        top.write_text("\n".join([*lines, ""]), "utf-8", "surrogateescape")
        return top

    def original(self, text: str) -> str:
        """Return a complaint about copies as one about the files themselves."""
        for path, copy in sorted(self._names.items(), key=lambda item: -len(str(item[1]))):
            if found := re.match(rf"{re.escape(str(copy))}:(\d+): ", text):
                keyword = split_line(copy.read_text("utf-8", "replace").split("\n")[int(found[1]) - 1])[0]
                if re.fullmatch(r"[a-z0-9]{1,40}", keyword) and keyword not in text.lower():
                    text += f" ({keyword})"
            text = text.replace(str(copy), str(path))
        return text

    def _copy(self, path: Path, folder: Path, *, checked: bool) -> Path:
        """Return the copy of a file, which is made once: one that includes itself is left to ssh to refuse."""
        if path in self._names:
            return self._names[path]
        if len(self._names) >= MAX_FILES:
            raise ConfigError(f"{path}: more than {MAX_FILES} files with all includes")
        copy = self._names[path] = self._folder / f"copy-{len(self._names)}-"
        text = ssh_config.read_config_file(path, checked=checked) or ""
        lines = [self._line(line, f"{path}:{number}", folder) for number, line in enumerate(text.split("\n"), 1)]
        copy.write_text("\n".join(lines), "utf-8", "surrogateescape", newline="\n")
        copy.chmod(0o600)
        return copy

    def _line(self, line: str, where: str, folder: Path) -> str:
        keyword, rest = split_line(line)
        if keyword in self._left_out:
            _say_once(f"{where}: the option {keyword} is of a later OpenSSH than the one here; it is left out")
            return ""
        if keyword == "match" and (unknown := self._left_out & _criteria(rest)):
            _say_once(f"{where}: the Match criterion {', '.join(unknown)} is not known to this ssh; the block is left out")
            return "Host !*"
        if keyword not in ("include", "userknownhostsfile", "identityagent"):
            return line
        try:
            arguments = split_arguments(rest)
        except ValueError:
            return line
        home = self._question.home
        if keyword == "include":
            files = [path for each in arguments for path in ssh_config.included(each, folder, home)]
            copies = [str(self._copy(path, folder, checked=True)) for path in files]
            return f"Include {' '.join(copies)}" if copies else "" if all(arguments) else line
        escaped = str(home).replace("%", "%%")
        expanded = [re.sub(r"%[%d]", lambda found: escaped if found[0] == "%d" else found[0], each) for each in arguments]
        return " ".join([keyword, *(_quoted(expand_tilde(each, Path(escaped))) for each in expanded)])


def _criteria(rest: str) -> set[str]:
    words: set[str] = set()
    current: str | None = rest
    while current:
        word, current = split_word(current)
        words |= {(word or "").lstrip("!")}
    return words


def _quoted(word: str) -> str:
    return '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'


_said: set[str] = set()


def _say_once(text: str) -> None:
    if text not in _said:
        _said.add(text)
        echo(f"lupin: {text}", err=True)
