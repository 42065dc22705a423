"""Shell scripts that read a file and write one atomically, for paths that the SFTP user may not access."""

from __future__ import annotations

import base64
import shlex

from lupin_cli.connection.base import Output, TargetError

_ABSENT = 44  # exit status of read_file_script if the file does not exist


def write_file_script(path: str, size: int, mode: int) -> str:
    """Return sh that writes `size` bytes of its standard input to `path`.

    If the link is cut the input ends early: the sizes differ and the old file stays. `sync FILE` exists in coreutils only;
    busybox's `sync` writes back everything, which takes longer and is as safe.
    """
    return f"""
set -u
path={_quoted_path(path)}
new="$path.lupin-$$"
umask 077
trap 'rm -f -- "$new"' EXIT
trap 'exit 143' HUP INT TERM
cat >"$new" || exit 1
size=$(wc -c <"$new") && [ "$size" -eq {size} ] || {{ echo "only $size of {size} bytes arrived" >&2; exit 1; }}
chmod {mode:o} -- "$new" && {{ sync -- "$new" 2>/dev/null || sync; }} && mv -f -- "$new" "$path" || exit 1
sync -- "$(dirname -- "$path")" 2>/dev/null || :
"""


def read_file_script(path: str) -> str:
    """Return sh that prints the content of `path` as base64; it exits with 44 if the file does not exist."""
    return f'path={_quoted_path(path)}\n[ -e "$path" ] || exit {_ABSENT}\nbase64 <"$path"\n'


def decode_file(name: str, path: str, output: Output) -> bytes | None:
    """Return the content that `read_file_script` printed on target `name`, or None without a file. Raises TargetError."""
    if output.status == _ABSENT:
        return None
    if output.ok and output.truncated:
        raise TargetError(f"{name}: {path} is too large to be read at once")
    if not output.ok:
        raise TargetError(f"{name}: could not read {path}: {failure_reason(output)}")
    return base64.b64decode(output.stdout)


def failure_reason(output: Output) -> str:
    """Return the last line that a failed script printed, or its exit status."""
    lines = (output.stderr or output.stdout).strip().splitlines()
    return lines[-1] if lines else f"it exited with status {output.status}"


def _quoted_path(path: str) -> str:
    """Quote `path` for a shell; a leading `~/` becomes the home directory of the user who runs it."""
    return '"$HOME"/' + shlex.quote(path[2:]) if path.startswith("~/") else shlex.quote(path)
