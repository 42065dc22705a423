"""Many scripts in one round trip: the program that runs them side by side, and the reader of what it prints.

The program is POSIX sh and needs coreutils or busybox (`timeout`, `head`, `base64`, `cat`), no Python and no file that can be
written: a full disk and a read-only root answer as any other. Every line it prints carries a nonce, and what scripts print
travels as base64, so that neither one script's output nor a chatty start file of the login shell can pass for another's.
"""

from __future__ import annotations

import base64
import binascii
import math
import secrets
import shlex
import time
from collections.abc import Sequence
from dataclasses import field

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import ROOT_REFUSED, Output, Script

STDOUT_CAP_BYTES = 1024 * 1024  # of each script; what is cut says so
STDERR_LINES, STDERR_COLUMNS = 100, 3000  # a line is one write: writes up to PIPE_BUF (4096) never mix
STRAY_GRACE_S = 2.0  # after a script's end, for its output: a child in a session of its own may hold the pipe for ever
ARGUMENT_LIMIT_BYTES = 100_000  # Linux allows 131 072 for one argument

# What the login shell is asked to run. It may be any shell: this is one plain command with no single quote inside.
READ_PROGRAM = "exec /bin/sh -c 'eval \"$(head -c {size})\"'"
# The same for a batch, always in the same words: a shell can be made ready before it is known what to ask. Its first line tells
# the bound and the size. What hangs on to a stray's pipe is ended at that bound as well, when nobody waits for it any more.
READ_BATCH = 'exec /bin/sh -c \'read -r bound size && exec timeout -k 1 $bound /bin/sh -c "eval \\"\\$(head -c $size)\\""\''

# Debian gives SSH commands no sbin; messages must be in one language to be read. What start files may have set to bend programs
# for a person's own hands is taken back. A bash that finds itself on a socket takes it for a login, unless another shell is
# around it, and reads the start file once more.
BENDING = "LANGUAGE POSIXLY_CORRECT CDPATH BASH_ENV ENV GREP_OPTIONS TAR_OPTIONS GZIP COLUMNS BLOCKSIZE BLOCK_SIZE TIME_STYLE"
ENVIRONMENT = (
    "LC_ALL=C SHLVL=2 PATH=${PATH:-/usr/local/bin:/usr/bin:/bin}:/usr/local/sbin:/usr/sbin:/sbin; "
    f"export LC_ALL SHLVL PATH; unset {BENDING}\n"
)

# one INDEX BOUND_S TEXT: run one script. Four processes a script, since forty of them run at once on a small board.
#   `timeout` gives it a process group of its own, so what it leaves in the background is ended with it.
#   fd 4 is the way out, fd 3 its standard error; it holds neither. The shell itself reads what comes there, up to a last line.
#   /proc/uptime is read by the shell too: a clock that no `date -s` moves.
_ONE = (
    """
line() { printf '%s %s %s\\n' "$n" "$1" "$2" >&4; }
one() {
  {
    u0=0; read -r u0 rest </proc/uptime
    o=$( {
      timeout -k 1 "$2" /bin/sh -c "$3" 2>&3 3>&- 4>&- </dev/null &
      wait $!
      status=$?
      kill -s TERM -- "-$!"
      u1=0; read -r u1 rest </proc/uptime
      line s "$1 $status $u0 $u1"
    } | head -c STDOUT_CAP 3>&- 4>&- | base64 $wide 3>&- 4>&- )
    for part in $o; do printf '%s o %s %s\\n' "$n" "$1" "$part"; done >&4
    printf '\\n%s end\\n' "$n" >&3
  } 3>&1 | {
    count=0
    while IFS= read -r said; do
      [ "$said" = "$n end" ] && line z "$1" && break
      count=$((count + 1))
      [ $count -gt STDERR_LINES ] || printf '%s e %s %.STDERR_COLUMNSs\\n' "$n" "$1" "$said" >&4
    done
  }
}
""".replace("STDOUT_CAP", str(STDOUT_CAP_BYTES + 1))
    .replace("STDERR_LINES", str(STDERR_LINES))
    .replace("STDERR_COLUMNS", str(STDERR_COLUMNS))
)


# In lines of 76 characters each answer is dozens of writes and packets; a line here is one write, as above. Old busyboxes know
# no such option.
_WIDE = "base64 -w 3000 && wide='-w 3000' || wide=\n"
# One write, before any script has begun: whoever knows when the program's last byte left knows the clock to a few ms.
_READ_CLOCK = 'date "+$n c %s.%N" >&4'


def _program(nonce: str, calls: Sequence[str]) -> str:
    """A program that runs `calls` side by side. What the shell itself says goes nowhere; frames leave through fd 4."""
    start = f"exec 4>&1 >/dev/null 2>&1 </dev/null\n{ENVIRONMENT}n={nonce}\nnewline='\n'\nset -f\n{_WIDE}"
    return f"main() {{\n{start}{_ONE}line h up\n" + " &\n".join([*calls, "wait\n"]) + "}\nmain\n"


@dataclass
class BatchProgram:
    """A batch as it goes over the wire: `payload` is for the standard input of what runs READ_BATCH."""

    payload: bytes
    reader: FrameReader


def batch_program(scripts: Sequence[Script], bound_s: float, sudo_password: str | None = None) -> BatchProgram:
    """The program for `scripts`, each bounded by its own time-out and by `bound_s` (in whole seconds, rounded up).

    Root scripts run in one sudo, or directly where the user is root. Raises ValueError for two scripts of one name or a
    script that no argument can hold.
    """
    require_fit(scripts)
    nonce = secrets.token_hex(8)
    bounds_s = [_whole_seconds(script, bound_s) for script in scripts]
    calls: dict[bool, list[str]] = {False: [], True: []}
    for index, script in enumerate(scripts):
        calls[script.root].append(f"one {index} {bounds_s[index]} {shlex.quote(script.text)}")
    user_calls = [_READ_CLOCK, *calls[False]]
    if calls[True]:
        user_calls.append(_as_root(_program(nonce, calls[True]), max(bounds_s) + 3, sudo_password))
    program = _program(nonce, user_calls).encode("utf-8", "surrogateescape")
    lead = f"{max(bounds_s, default=1) + 3} {len(program)}\n".encode()
    return BatchProgram(lead + program, FrameReader(nonce, list(scripts), bounds_s))


def require_fit(scripts: Sequence[Script]) -> None:
    """Raises ValueError for two scripts of one name or a script that no argument can hold."""
    names = [script.name for script in scripts]
    if len(set(names)) != len(names):
        raise ValueError(f"two scripts of one name: {sorted(name for name in set(names) if names.count(name) > 1)}")
    for script in scripts:
        if "\0" in script.text or len(script.text.encode()) > ARGUMENT_LIMIT_BYTES:
            raise ValueError(f"script {script.name!r} has a NUL in it or more than {ARGUMENT_LIMIT_BYTES} bytes")


def _whole_seconds(script: Script, bound_s: float) -> int:
    """busybox's `timeout` knows whole seconds only."""
    return max(1, math.ceil(min(script.timeout_s, bound_s)))


def sudo_command(password: str | None) -> str:
    """`sudo` that never waits for a terminal."""
    return "sudo -n" if password is None else "sudo -S -p ''"


def sudo_check(password: str | None) -> str:
    """sh that fails where sudo doesn't take the password: tried once alone, since a wrong one would be asked for twice more,
    the script's lines would be taken for it, and three failures lock an account on some machines."""
    return "true" if password is None else f"printf '%s\\n' {shlex.quote(password)} | sudo -S -p '' -k true"


# sudo reads the password from its standard input, if it wants one at all: what it leaves must not reach the shell behind it.
SKIP_PASSWORD = 'while IFS= read -r skipped && [ "$skipped" != lupin-begins ]; do :; done'


def _as_root(program: str, bound_s: int, password: str | None) -> str:
    runner = shlex.quote(SKIP_PASSWORD + '; eval "$(cat)"')
    given = "" if password is None else f"printf '%s\\n' {shlex.quote(password)}; "
    sudo = f"{sudo_command(password)} timeout -k 1 {bound_s} /bin/sh -c {runner}"
    return (
        f'{{ p={shlex.quote(program)}; if [ "$(id -u)" = 0 ]; then ( exec 1>&4; eval "$p" ); else '
        f"x=$( {{ {sudo_check(password)} && {{ {given}printf 'lupin-begins\\n%s' \"$p\"; }} | {sudo}; }} 2>&1 >&4 ); "
        'line r "${x##*"$newline"}"; fi; }'
    )


@dataclass
class _Partial:
    stdout: list[bytes] = field(default_factory=list)
    stderr: list[bytes] = field(default_factory=list)
    status: int | None = None
    duration_s: float = 0.0
    ended_s: float = math.inf  # when the last of it was heard, once the script has ended; monotonic
    done: bool = False


class FrameReader:
    """Puts the outputs of a batch together from whatever pieces arrive."""

    def __init__(self, nonce: str, scripts: list[Script], bounds_s: list[int]) -> None:
        self._prefix = nonce.encode() + b" "
        self._scripts, self._bounds_s = scripts, bounds_s
        self._partial = [_Partial() for _ in scripts]
        self._rest = b""
        self._hellos = 0
        self._root_ended = False
        self.refusal: str | None = None  # sudo's word, where it refused
        self.clock: tuple[str, int] | None = None  # what the wall clock said, and when that was heard, monotonic ns

    def feed(self, data: bytes) -> None:
        """Take the next bytes of the program's output; lines that aren't frames are somebody else's and are passed over."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            if line.startswith(self._prefix):
                self._frame(line[len(self._prefix) :])
        if len(self._rest) > 8192:  # no frame is so long: noise without a line's end
            self._rest = b""

    @property
    def started(self) -> bool:
        """Whether the program has come up at all."""
        return self._hellos > 0

    @property
    def done(self) -> bool:
        """Whether every script has answered, or can't any more."""
        now_s = time.monotonic()
        return self.started and all(
            part.done or (script.root and self._root_ended) or now_s > part.ended_s + STRAY_GRACE_S
            for script, part in zip(self._scripts, self._partial)
        )

    def _frame(self, frame: bytes) -> None:
        kind, _, rest = frame.partition(b" ")
        if kind == b"h":
            self._hellos += 1
        elif kind == b"c":
            self.clock = rest.decode("ascii", "backslashreplace"), time.monotonic_ns()
        elif kind == b"r":
            self._root_ended = True
            if self._hellos < 2:
                self.refusal = rest.decode("utf-8", "replace").strip() or "sudo ran nothing and said nothing"
        else:
            index, _, text = rest.partition(b" ")
            part = self._partial[int(index)]
            if kind == b"o":
                part.stdout.append(text)
            elif kind == b"e":
                part.stderr.append(text)
            elif kind == b"s":
                status, start, end = text.split()
                part.duration_s = max(0.0, float(end) - float(start))
                part.status = int(status)
            elif kind == b"z":
                part.done = True
            if part.status is not None:
                part.ended_s = time.monotonic()

    def outputs(self, why_cut: str) -> dict[str, Output]:
        """One output a script, by name; `why_cut` goes to the standard error of those that were not heard to the end."""
        heard = zip(self._scripts, self._bounds_s, self._partial)
        return {script.name: self._output(script, end_s, part, why_cut) for script, end_s, part in heard}

    def _output(self, script: Script, end_s: int, part: _Partial, why_cut: str) -> Output:
        try:
            raw = base64.b64decode(b"".join(part.stdout))
        except binascii.Error:  # cut within a group of four
            encoded = b"".join(part.stdout)
            raw = base64.b64decode(encoded[: len(encoded) // 4 * 4])
        stderr = b"\n".join(part.stderr).decode("utf-8", "backslashreplace")
        status = part.status
        if not part.done and time.monotonic() > part.ended_s + STRAY_GRACE_S:
            stderr = (stderr + "\na process that it left behind holds its output").lstrip()
        elif not part.done:
            refused = script.root and self.refusal is not None
            # Also where its status was heard already: what it printed comes after that.
            status, stderr = None, f"{ROOT_REFUSED}{self.refusal}" if refused else (stderr or why_cut)
        elif status in (124, 137, 143) and part.duration_s >= end_s - 0.05:
            status, stderr = None, stderr or f"no end within {end_s} s"
        return Output(
            status,
            raw[:STDOUT_CAP_BYTES].decode("utf-8", "backslashreplace"),
            stderr,
            part.duration_s,
            truncated=len(raw) > STDOUT_CAP_BYTES or not part.done,
        )
