"""Many scripts in one round trip: the program that runs them in parallel, and the parser of what it prints.

The program is POSIX sh and needs coreutils or busybox (`timeout`, `head`, `base64`, `cat`). It needs neither Python nor a
writable file, so it also works on a full disk and a read-only root. Each line that it prints, a frame, starts with a
nonce, and the scripts' output travels as base64: neither a script nor a chatty startup file of a shell can forge a frame.

A frame is `NONCE KIND ...`:
  h up                            the program has started; a second one comes from the root part
  c SECONDS                       the wall clock, before any script starts
  o INDEX BASE64                  a part of a script's standard output
  e INDEX LINE                    a line of its standard error
  s INDEX STATUS UPTIME UPTIME    its exit status, and /proc/uptime at its start and end
  z INDEX                         all of its output has been sent
  r MESSAGE                       the root part has ended; sudo's last line
"""

from __future__ import annotations

import base64
import binascii
import math
import secrets
import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from lupin_cli.connection.base import ROOT_REFUSED, Output, Script

STDOUT_CAP_BYTES = 1024 * 1024  # of each script; Output.truncated says that more was printed
STDERR_LINES, STDERR_COLUMNS = 100, 3000  # a line is one write, and writes up to PIPE_BUF (4096) are never mixed
STRAY_GRACE_S = 2.0  # how long to read on after a script has exited: a child in its own session may hold the pipe forever
ARGUMENT_LIMIT_BYTES = 100_000  # Linux allows 131 072 for one argument
TIMEOUT_STATUSES = (124, 137, 143)  # of a command that `timeout` terminated, by SIGTERM or SIGKILL
HELD_BY_STRAY = "a background process that it started still holds its output"
_FRAME_LIMIT_BYTES = 8192  # no frame is longer; more than this without a line break is noise

# The login shell's command. It may be any shell, so this is one plain command without a single quote inside its quotes.
READ_PROGRAM = "exec /bin/sh -c 'eval \"$(head -c {size})\"'"
# The same for a batch. This `timeout` also terminates processes that hold a pipe of the batch after Lupin stopped reading it.
_READ_BATCH = "exec timeout -k 1 {timeout_s} /bin/sh -c 'eval \"$(head -c {size})\"'"

# Debian gives SSH commands no sbin, and messages must be in one language to be parsed. Variables by which users adjust
# programs for interactive work are unset. SHLVL=2: a bash whose input is a socket assumes that sshd started it and reads
# ~/.bashrc again, unless it runs inside another shell.
_USER_SETTINGS = (
    "LANGUAGE POSIXLY_CORRECT CDPATH BASH_ENV ENV GREP_OPTIONS TAR_OPTIONS GZIP COLUMNS BLOCKSIZE BLOCK_SIZE TIME_STYLE"
)
ENVIRONMENT = (
    "LC_ALL=C SHLVL=2 PATH=${PATH:-/usr/local/bin:/usr/bin:/bin}:/usr/local/sbin:/usr/sbin:/sbin; "
    f"export LC_ALL SHLVL PATH; unset {_USER_SETTINGS}\n"
)

# Every user can read the arguments of a process, but only its own user its environment: a script's text is there.
EVALUATE = 'eval "unset lupin_script; $lupin_script"'

# run_script INDEX TIMEOUT_S TEXT: run one script, with only four processes, because forty scripts run at once on a small board.
#   `timeout` gives it its own process group, so that the background processes it leaves are terminated with it.
#   Frames are written to fd 4. fd 3 collects the script's standard error, which the shell itself reads up to an end line; the
#   script's children must not inherit either.
#   Times come from /proc/uptime, which `date -s` does not move, and which the shell can read without a process.
_RUN_SCRIPT = (
    """
frame() { printf '%s %s %s\\n' "$n" "$1" "$2" >&4; }
run_script() {
  {
    u0=0; read -r u0 rest </proc/uptime
    o=$( {
      lupin_script=$3 timeout -k 1 "$2" /bin/sh -c 'EVALUATE' 2>&3 3>&- 4>&- </dev/null &
      wait $!
      status=$?
      kill -s TERM -- "-$!"
      u1=0; read -r u1 rest </proc/uptime
      frame s "$1 $status $u0 $u1"
    } | head -c STDOUT_CAP 3>&- 4>&- | base64 $wide 3>&- 4>&- )
    for part in $o; do printf '%s o %s %s\\n' "$n" "$1" "$part"; done >&4
    printf '\\n%s end\\n' "$n" >&3
  } 3>&1 | {
    count=0
    while IFS= read -r text; do
      [ "$text" = "$n end" ] && frame z "$1" && break
      count=$((count + 1))
      [ $count -gt STDERR_LINES ] || printf '%s e %s %.STDERR_COLUMNSs\\n' "$n" "$1" "$text" >&4
    done
  }
}
""".replace("EVALUATE", EVALUATE)
    .replace("STDOUT_CAP", str(STDOUT_CAP_BYTES + 1))
    .replace("STDERR_LINES", str(STDERR_LINES))
    .replace("STDERR_COLUMNS", str(STDERR_COLUMNS))
)


# base64's default of 76 characters a line would make each output dozens of writes and packets. Old busyboxes lack the option.
_WIDE = "base64 -w 3000 && wide='-w 3000' || wide=\n"
# Sent before any script starts: with the time at which the program's last byte was sent, it gives the clock to within a few ms.
_READ_CLOCK = 'date "+$n c %s.%N" >&4'


def _program(nonce: str, calls: Sequence[str]) -> str:
    """Return sh that runs `calls` in parallel. The shell's own messages are discarded; frames go to fd 4."""
    start = f"exec 4>&1 >/dev/null 2>&1 </dev/null\n{ENVIRONMENT}n={nonce}\nnewline='\n'\nset -f\n{_WIDE}"
    return f"main() {{\n{start}{_RUN_SCRIPT}frame h up\n" + " &\n".join([*calls, "wait\n"]) + "}\nmain\n"


@dataclass
class BatchProgram:
    """A batch ready to send: the login shell runs `command` and gets `payload` on standard input."""

    command: str
    payload: bytes
    reader: FrameReader


def batch_program(scripts: Sequence[Script], timeout_s: float, sudo_password: str | None = None) -> BatchProgram:
    """Return the program for `scripts`, each bounded by its own timeout and by `timeout_s` (in whole seconds, rounded up).

    All root scripts run in one sudo, or directly if the user is root. Raises ValueError like `validate`.
    """
    validate(scripts)
    nonce = secrets.token_hex(8)
    timeouts_s = [_whole_seconds(script, timeout_s) for script in scripts]
    calls: dict[bool, list[str]] = {False: [], True: []}
    for index, script in enumerate(scripts):
        calls[script.root].append(f"run_script {index} {timeouts_s[index]} {shlex.quote(script.text)}")
    user_calls = [_READ_CLOCK, *calls[False]]
    if calls[True]:
        user_calls.append(_as_root(_program(nonce, calls[True]), max(timeouts_s) + 3, sudo_password))
    program = _program(nonce, user_calls).encode("utf-8", "surrogateescape")
    command = _READ_BATCH.format(timeout_s=max(timeouts_s, default=1) + 3, size=len(program))
    return BatchProgram(command, program, FrameReader(nonce, list(scripts), timeouts_s))


def validate(scripts: Sequence[Script]) -> None:
    """Raise ValueError for two scripts of the same name, or a script that does not fit into one argument of a command."""
    names = [script.name for script in scripts]
    if len(set(names)) != len(names):
        raise ValueError(f"two scripts have the same name: {sorted(name for name in set(names) if names.count(name) > 1)}")
    for script in scripts:
        if "\0" in script.text or len(script.text.encode()) > ARGUMENT_LIMIT_BYTES:
            raise ValueError(f"script {script.name!r} has a NUL in it or more than {ARGUMENT_LIMIT_BYTES} bytes")


def _whole_seconds(script: Script, timeout_s: float) -> int:
    """Return the script's timeout, rounded up: busybox's `timeout` takes whole seconds only."""
    return max(1, math.ceil(min(script.timeout_s, timeout_s)))


def sudo_command(password: str | None) -> str:
    """Return a `sudo` command that never waits for a terminal."""
    return "sudo -n" if password is None else "sudo -S -p ''"


def sudo_check(password: str | None) -> str:
    """Return sh that fails if sudo refuses the password.

    The password is tried alone first: sudo would ask for a wrong one twice more and take the script's lines for it, and on some
    machines three failures lock the account.
    """
    return "true" if password is None else f"printf '%s\\n' {shlex.quote(password)} | sudo -S -p '' -k true"


# sudo reads the password from standard input only if it needs one. If not, the line must not reach the shell that sudo starts.
SKIP_PASSWORD = 'while IFS= read -r skipped && [ "$skipped" != lupin-begins ]; do :; done'  # noqa: S105 -- no password


def _as_root(program: str, timeout_s: int, password: str | None) -> str:
    runner = shlex.quote(SKIP_PASSWORD + '; eval "$(cat)"')
    given = "" if password is None else f"printf '%s\\n' {shlex.quote(password)}; "
    sudo = f"{sudo_command(password)} timeout -k 1 {timeout_s} /bin/sh -c {runner}"
    return (
        f'{{ p={shlex.quote(program)}; if [ "$(id -u)" = 0 ]; then ( exec 1>&4; eval "$p" ); else '
        f"x=$( {{ {sudo_check(password)} && {{ {given}printf 'lupin-begins\\n%s' \"$p\"; }} | {sudo}; }} 2>&1 >&4 ); "
        'frame r "${x##*"$newline"}"; fi; }'
    )


@dataclass
class _PartialOutput:
    stdout: list[bytes] = field(default_factory=list)
    stderr: list[bytes] = field(default_factory=list)
    status: int | None = None
    duration_s: float = 0.0
    last_frame_s: float = math.inf  # when its last frame arrived, once the script has exited; monotonic
    done: bool = False


class FrameReader:
    """Assembles the outputs of a batch from the program's output, which may arrive in pieces of any size."""

    def __init__(self, nonce: str, scripts: list[Script], timeouts_s: list[int]) -> None:
        self._prefix = nonce.encode() + b" "
        self._scripts, self._timeouts_s = scripts, timeouts_s
        self._partial = [_PartialOutput() for _ in scripts]
        self._rest = b""
        self._programs_started = 0  # the user's, then the root part
        self._root_ended = False
        self.refusal: str | None = None  # sudo's message if it refused
        self.clock: tuple[str, int] | None = None  # the wall clock as printed, and when it arrived in monotonic ns

    def feed(self, data: bytes) -> None:
        """Take the next bytes of the program's output. Lines that are not frames come from startup files and are ignored."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            if line.startswith(self._prefix):
                self._frame(line[len(self._prefix) :])
        if len(self._rest) > _FRAME_LIMIT_BYTES:
            self._rest = b""

    @property
    def started(self) -> bool:
        """Whether the program has started."""
        return self._programs_started > 0

    @property
    def done(self) -> bool:
        """Whether all output of every script has arrived, or no more can arrive."""
        now_s = time.monotonic()
        return self.started and all(
            part.done or (script.root and self._root_ended) or now_s > part.last_frame_s + STRAY_GRACE_S
            for script, part in zip(self._scripts, self._partial)
        )

    def _frame(self, frame: bytes) -> None:
        kind, _, rest = frame.partition(b" ")
        if kind == b"h":
            self._programs_started += 1
        elif kind == b"c":
            self.clock = rest.decode("ascii", "backslashreplace"), time.monotonic_ns()
        elif kind == b"r":
            self._root_ended = True
            if self._programs_started < 2:
                self.refusal = rest.decode("utf-8", "replace").strip() or "sudo ran nothing and printed nothing"
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
                part.last_frame_s = time.monotonic()

    def outputs(self, why_cut: str) -> dict[str, Output]:
        """Return an output for each script, by name. `why_cut` becomes the standard error of incomplete ones that have none."""
        rows = zip(self._scripts, self._timeouts_s, self._partial)
        return {script.name: self._output(script, timeout_s, part, why_cut) for script, timeout_s, part in rows}

    def _output(self, script: Script, timeout_s: int, part: _PartialOutput, why_cut: str) -> Output:
        try:
            raw = base64.b64decode(b"".join(part.stdout))
        except binascii.Error:  # cut within a group of four
            encoded = b"".join(part.stdout)
            raw = base64.b64decode(encoded[: len(encoded) // 4 * 4])
        stderr = b"\n".join(part.stderr).decode("utf-8", "backslashreplace")
        status = part.status
        if not part.done and time.monotonic() > part.last_frame_s + STRAY_GRACE_S:
            stderr = f"{stderr}\n{HELD_BY_STRAY}".lstrip()
        elif not part.done:
            refused = script.root and self.refusal is not None
            # Even if its status has arrived: its output comes after that.
            status, stderr = None, f"{ROOT_REFUSED}{self.refusal}" if refused else (stderr or why_cut)
        elif status in TIMEOUT_STATUSES and part.duration_s >= timeout_s - 0.05:
            status, stderr = None, stderr or f"did not finish within {timeout_s} s"
        return Output(
            status,
            raw[:STDOUT_CAP_BYTES].decode("utf-8", "backslashreplace"),
            stderr,
            part.duration_s,
            truncated=len(raw) > STDOUT_CAP_BYTES or not part.done,
        )
