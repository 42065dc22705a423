"""What stands at a path of a target, and how to put it back as it was."""

from __future__ import annotations

import base64
import difflib
from typing import Any

from lupin_cli.operations.base import OperationError
from lupin_cli.operations.shell import change, look, quote
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

LARGEST_KEPT_BYTES = 1024 * 1024  # an old content larger than this isn't kept for undo, so it isn't replaced either

# One line: kind, mode, owner:group, then what a link points to.
_STAT = """
p={path}
if [ -L "$p" ]; then printf 'link 0 -:- %s\\n' "$(readlink -- "$p")"
elif [ -e "$p" ]; then
  if [ -d "$p" ]; then k=directory; elif [ -f "$p" ]; then k=file; else k=other; fi
  printf '%s %s\\n' "$k" "$(stat -c '%a %U:%G' -- "$p")"
else
  d=$(dirname -- "$p")
  while [ ! -e "$d" ]; do d=$(dirname -- "$d"); done
  if [ -x "$d" ]; then echo absent; else echo hidden; fi
fi
"""


@dataclass(frozen=True)
class Entry:
    """What stands at a path: kind is absent | file | directory | link | other."""

    kind: str
    mode: str = ""  # octal without a leading zero: 644
    owner: str = ""  # user:group
    points_to: str = ""


# What a small file holds, in the same answer.
_CONTENT = """
if [ -f "$p" ] && [ ! -L "$p" ] && [ "$(stat -c %s -- "$p")" -le {largest} ]; then base64 -w 0 <"$p" && echo ' whole'; fi
"""
_SMALL_BYTES = 512 * 1024


def read_file(target: Target, path: str, root: bool, also: str = "") -> tuple[Entry, bytes | None, str]:
    """What stands at a path, the bytes where it is a file, and what `also` (a script) prints: one question, one answer."""
    script = _STAT.format(path=quote(path)) + _CONTENT.format(largest=_SMALL_BYTES) + f"echo '@ also'\n{also}\nexit 0\n"
    output = look(target, script, root=root)
    said, _, extra = output.stdout.partition("@ also\n")
    first, _, rest = said.partition("\n")
    entry = _read_stat(target, path, first)
    if entry.kind != "file":
        return entry, None, extra
    if rest.endswith(" whole\n"):
        return entry, base64.b64decode(rest.removesuffix(" whole\n")), extra
    return entry, target.get(path, root=root), extra  # a large one, or one that this user may not read: get says which


def read_entry(target: Target, path: str, root: bool) -> Entry:
    """Look at a path, without following a link. Raises OperationError where that isn't allowed."""
    return _read_stat(target, path, look(target, _STAT.format(path=quote(path)), root=root).stdout)


def _read_stat(target: Target, path: str, line: str) -> Entry:
    words = line.strip("\n").split(" ", 3)
    if words[0] not in ("absent", "file", "directory", "link", "other"):
        raise OperationError(f"{path} on {target.name} can't be looked at by {target.user}; the step needs: root: true")
    if words[0] == "absent":
        return Entry("absent")
    return Entry(words[0], words[1], words[2], words[3] if len(words) > 3 else "")


def describe(entry: Entry, content: bytes | None) -> dict[str, Any]:
    """An entry as undo needs it; raises OperationError where its content is too large to be kept."""
    before: dict[str, Any] = {"kind": entry.kind}
    if entry.kind == "link":
        before["points_to"] = entry.points_to
    elif entry.kind != "absent":
        before.update(mode=entry.mode, owner=entry.owner)
    if entry.kind == "file":
        if content is not None and len(content) > LARGEST_KEPT_BYTES:
            raise OperationError(f"what stands there has {len(content)} bytes, more than undo keeps: move it away by hand")
        before["content"] = base64.b64encode(content or b"").decode()
    return before


def restore(target: Target, path: str, before: dict[str, Any], root: bool) -> None:
    """Put a path back as `before` says. Raises OperationError. Doing it twice is doing it once."""
    name = quote(path)
    if before["kind"] == "absent":
        change(target, f"rm -f -- {name}", f"remove {path}", root=root)
    elif before["kind"] == "link":
        link_atomically(target, path, before["points_to"], root)
    elif before["kind"] == "file":
        target.put(path, base64.b64decode(before["content"]), mode=int(before["mode"], 8), root=root)
        own(target, path, before["owner"], root)
    else:
        raise OperationError(f"a {before['kind']} was at {path}; that can't be put back")


def link_atomically(target: Target, path: str, to: str, root: bool) -> None:
    """Make a symbolic link, or turn an existing one, in one rename: nobody ever finds it missing."""
    script = f"""
set -eu
path={quote(path)}
new="$path.lupin-$$"
trap 'rm -f -- "$new"' EXIT
ln -s -- {quote(to)} "$new"
mv -fT -- "$new" "$path"
sync -- "$(dirname -- "$path")" 2>/dev/null || :
"""
    change(target, script, f"link {path} to {to}", root=root)


def own(target: Target, path: str, owner: str, root: bool) -> None:
    """Give a path to `owner` (user:group), where it is another's."""
    name = quote(path)
    script = f'[ "$(stat -c %U:%G -- {name})" = {quote(owner)} ] || chown -h -- {quote(owner)} {name}'
    change(target, script, f"give {path} to {owner}", root=root)


def unified_diff(path: str, old: bytes | None, new: bytes | None) -> str:
    """What changes in a text, as a unified diff; a sentence where it isn't text."""
    try:
        before, after = (None if data is None else data.decode() for data in (old, new))
    except UnicodeDecodeError:
        return f"{path}: {len(old or b'')} bytes become {len(new or b'')}; not text"
    lines = difflib.unified_diff(
        (before or "").splitlines(), (after or "").splitlines(), "/dev/null" if old is None else path,
        "/dev/null" if new is None else path, lineterm="",
    )  # fmt: skip
    return "\n".join(lines)
