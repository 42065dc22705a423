"""Files through a shell, for paths that SFTP's user may not touch: whole or not at all."""

from __future__ import annotations

import base64
import shlex

from lupin_cli.target.base import Output, TargetError

_ABSENT = 44


def quoted_path(path: str) -> str:
    """`path` for a shell; a leading `~/` is the home of whoever runs it."""
    return '"$HOME"/' + shlex.quote(path[2:]) if path.startswith("~/") else shlex.quote(path)


def put_program(path: str, size: int, mode: int) -> str:
    """sh that writes `size` bytes of its standard input to `path`.

    A link cut on the way ends the input early: the sizes differ and the old file stays. `sync` with an operand is coreutils';
    busybox's syncs everything, which takes longer and holds as well.
    """
    return f"""
set -u
path={quoted_path(path)}
new="$path.lupin-$$"
umask 077
trap 'rm -f -- "$new"' EXIT
trap 'exit 143' HUP INT TERM
cat >"$new" || exit 1
size=$(wc -c <"$new") && [ "$size" -eq {size} ] || {{ echo "only $size of {size} bytes arrived" >&2; exit 1; }}
chmod {mode:o} -- "$new" && {{ sync -- "$new" 2>/dev/null || sync; }} && mv -f -- "$new" "$path" || exit 1
sync -- "$(dirname -- "$path")" 2>/dev/null || :
"""


def get_program(path: str) -> str:
    """sh that prints the bytes of `path` as base64; exits 44 where there is no such file."""
    return f'path={quoted_path(path)}\n[ -e "$path" ] || exit {_ABSENT}\nbase64 <"$path"\n'


def read_get(name: str, path: str, output: Output) -> bytes | None:
    """The bytes that `get_program` printed. Raises TargetError."""
    if output.status == _ABSENT:
        return None
    if output.ok and output.truncated:
        raise TargetError(f"{name}: {path} is too large to be fetched whole")
    if not output.ok:
        raise TargetError(f"{name}: could not read {path}: {reason_of_failure(output)}")
    return base64.b64decode(output.stdout)


def reason_of_failure(output: Output) -> str:
    """The last line that was said, or how it ended."""
    lines = (output.stderr or output.stdout).strip().splitlines()
    return lines[-1] if lines else f"it ended with status {output.status}"
