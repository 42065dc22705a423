"""Shell scripts that read a file and write one atomically, for paths that the SFTP user may not access.

A script that runs as root must not be led elsewhere by the owner of a folder in which it works. It follows only symbolic links
of root, creates files that did not exist (O_EXCL), and acts on what it has opened, whoever renames what meanwhile.
"""

from __future__ import annotations

import base64
import shlex

from lupin_cli.connection.base import Output, TargetError

_ABSENT = 44  # exit status of read_file_script if the file does not exist

# enter_folder PATH makes the folder of PATH the working folder, and `name` the last part of PATH. For root it fails if a link
# on the way belongs to somebody else. The folder is entered first and compared then, so a swap in between is noticed too.
# open_item opens ./$name as descriptor 3, and lets $item name the opened file or folder; only root needs that.
SAFE_PATHS = r"""
real_folder() (
  real='' rest=$1/ links=0
  while [ -n "$rest" ]; do
    part=${rest%%/*} rest=${rest#*/}
    case $part in '' | .) continue ;; ..) real=${real%/*}; continue ;; esac
    if [ ! -L "$real/$part" ]; then real=$real/$part; continue; fi
    if [ "$(stat -c %u -- "$real/$part")" != 0 ]; then
      echo "$real/$part is a symbolic link that does not belong to root" >&2
      exit 1
    fi
    links=$((links + 1))
    [ "$links" -le 40 ] || exit 1
    to=$(readlink -- "$real/$part") || exit 1
    case $to in /*) real='' ;; esac
    rest=$to/$rest
  done
  printf '%s\n' "${real:-/}"
)
enter_folder() {
  name=$(basename -- "$1")
  set -- "$(dirname -- "$1")"
  case $1 in /*) ;; *) set -- "$PWD/$1" ;; esac
  cd -P -- "$1" 2>/dev/null || { stat -- "$1/." >/dev/null; return 1; }  # whose error has a reason
  [ "$(id -u)" = 0 ] || return 0
  set -- "$1" "$(real_folder "$1")"
  [ -n "$2" ] || return 1
  [ "$(pwd -P)" = "$2" ] || { echo "$1 was replaced while it was entered" >&2; return 1; }
}
open_item() {
  item=./$name
  [ "$(id -u)" = 0 ] || return 0
  if [ -L "$item" ] || { [ ! -f "$item" ] && [ ! -d "$item" ]; }; then
    echo "$name is neither a file nor a folder" >&2
    return 1
  fi
  exec 3<"$item" || return 1
  folder=$(pwd -P)
  [ "$(readlink /proc/self/fd/3)" = "${folder%/}/$name" ] || { echo "$name was replaced while it was opened" >&2; return 1; }
  item=/proc/self/fd/3
}
"""


def write_file_script(path: str, size: int, mode: int, owner: str = "") -> str:
    """Return sh that writes `size` bytes of its standard input to `path`, and gives the file to `owner` (user:group).

    If the link is cut the input ends early: the sizes differ and the old file stays. `sync FILE` exists in coreutils only;
    busybox's `sync` writes back everything, which takes longer and is as safe.
    """
    give = (
        f'[ "$(stat -L -c %U:%G $file)" = {shlex.quote(owner)} ] || chown -- {shlex.quote(owner)} $file || exit 1\n'
        if owner
        else ""
    )
    return f"""
set -u
{SAFE_PATHS}
enter_folder {_quoted_path(path)} || exit 1
new=$(mktemp -u -- "./$name.lupin-XXXXXXXX") || exit 1
umask 077
set -C
exec 3>"$new" || exit 1
set +C
trap 'rm -f -- "$new"' EXIT
trap 'exit 143' HUP INT TERM
file=/proc/self/fd/3
cat >&3 || exit 1
size=$(stat -L -c %s $file) && [ "$size" -eq {size} ] || {{ echo "only $size of {size} bytes arrived" >&2; exit 1; }}
{give}chmod {mode:o} $file && {{ sync $file 2>/dev/null || sync; }} && mv -fT -- "$new" "./$name" || exit 1
sync . 2>/dev/null || :
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
