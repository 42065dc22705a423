"""The state of a path on a target - kind, mode, owner, content - and how to restore it.

A probe made by `state_script` or `file_script` prints, on the first line: the kind, the mode, owner:group and, for a link, its
target. `file_script` adds the content of a small file as one line of base64, then a marker line and what `extra` prints.
"""

from __future__ import annotations

import base64
import binascii
import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from lupin_cli.connection.base import Output, Target
from lupin_cli.connection.shell_file_io import SAFE_PATHS
from lupin_cli.operations.base import OperationError
from lupin_cli.operations.shell import change, quote, text_of

MAX_KEPT_BYTES = 1024 * 1024  # undo keeps no larger content, so a larger file is not replaced either
_INLINE_BYTES = 512 * 1024  # encoded in base64, it is shorter than what a batch returns of a script's output

_STATE = """
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
_CONTENT = """
if [ -f "$p" ] && [ ! -L "$p" ] && [ "$(stat -c %s -- "$p")" -le {largest} ]; then base64 -w 0 <"$p" && echo ' whole'; fi
"""
_EXTRA = "@ extra\n"
_ATTRIBUTES = re.compile(r"([0-7]{1,4}) ([^:]+:[^:]+)\Z")


@dataclass(frozen=True)
class PathState:
    """What is at a path. `kind` is absent, file, directory, link or other; links are not followed."""

    kind: str
    mode: str = ""  # octal without a leading zero: 644
    owner: str = ""  # user:group
    points_to: str = ""


@dataclass(frozen=True)
class FileState(PathState):
    """A path's state with the content, None unless it is a file whose content is known, and the output of an extra script."""

    content: bytes | None = None
    extra: str = ""


def state_script(path: str) -> str:
    """Return the script that prints the state of a path."""
    return _STATE.format(path=quote(path))


def file_script(path: str, extra: str = "") -> str:
    """Return the script that prints a path's state, a small file's content, and what the script `extra` prints."""
    return f"{state_script(path)}{_CONTENT.format(largest=_INLINE_BYTES)}echo '{_EXTRA.strip()}'\n{extra}\nexit 0\n"


def parse_state(output: Output, path: str) -> PathState:
    """Read the output of `state_script`; raises OperationError if the path may not be examined or the output is odd."""
    kind, _, rest = text_of(output, f"the state of {path}").partition("\n")[0].partition(" ")
    if kind == "absent" and not rest:
        return PathState("absent")
    if kind == "hidden":
        raise OperationError(f"{path} cannot be examined by this user; the step needs: root: true")
    if kind == "link" and rest.startswith("0 -:- "):
        return PathState("link", "0", "-:-", rest.removeprefix("0 -:- "))
    match = _ATTRIBUTES.match(rest)
    if kind in ("file", "directory", "other") and match:
        return PathState(kind, match[1], match[2])
    raise OperationError(f"could not read the state of {path}: found {output.stdout[:80]!r}", f"ls -ld {path}")


def parse_file(output: Output, path: str) -> FileState:
    """Read the output of `file_script`; raises OperationError as `parse_state` does."""
    state = parse_state(output, path)
    body, found, extra = output.stdout.partition("\n")[2].partition(_EXTRA)
    if not found:
        raise OperationError(f"could not read {path}: the answer ends early", f"ls -ld {path}")
    content = None
    if state.kind in ("file", "link") and body.endswith(" whole\n"):
        try:
            content = base64.b64decode(body.removesuffix(" whole\n"), validate=True)
        except binascii.Error as error:
            raise OperationError(f"could not read the content of {path}: {error}") from error
    return FileState(state.kind, state.mode, state.owner, state.points_to, content, extra)


def complete_file(target: Target, output: Output, path: str, root: bool, *, follow_link: bool = False) -> Output:
    """Add the content that `file_script` left out: of a large file, or, with `follow_link`, of the file that a link points to.

    Raises TargetError, which says why, if the file cannot be read.
    """
    state = parse_file(output, path)
    if state.content is not None or (state.kind != "file" and not (follow_link and state.kind == "link")):
        return output
    content = target.get(path, root=root)
    if content is None:
        return output
    first, rest = output.stdout.split("\n", 1)
    encoded = base64.b64encode(content).decode()
    return replace(output, stdout=f"{first}\n{encoded} whole\n{_EXTRA}{rest.partition(_EXTRA)[2]}", truncated=False)


def state_before(state: FileState) -> dict[str, Any]:
    """Return a state in the form that `restore` takes; raises OperationError if the content is too large to be kept."""
    before: dict[str, Any] = {"kind": state.kind}
    if state.kind == "link":
        before["points_to"] = state.points_to
    elif state.kind != "absent":
        before.update(mode=state.mode, owner=state.owner)
    if state.kind == "file":
        if state.content is not None and len(state.content) > MAX_KEPT_BYTES:
            raise OperationError(
                f"the existing file has {len(state.content)} bytes, more than undo keeps ({MAX_KEPT_BYTES}); move it away"
            )
        before["content"] = base64.b64encode(state.content or b"").decode()
    return before


def all_of(state: PathState) -> bytes:
    """Return a state as bytes, which differ if anything of it differs."""
    content = state.content if isinstance(state, FileState) else None
    header = f"{state.kind} {state.mode} {state.owner} {state.points_to}\n"
    return header.encode("utf-8", "surrogateescape") + (content or b"")


def restore(target: Target, path: str, before: Mapping[str, Any], root: bool) -> None:
    """Restore a file, a link or its absence. Idempotent; raises OperationError."""
    if before["kind"] == "absent":
        remove(target, path, root)
    elif before["kind"] == "link":
        link_atomically(target, path, before["points_to"], root)
    elif before["kind"] == "file":
        put_owned(target, path, base64.b64decode(before["content"]), int(before["mode"], 8), before["owner"], root)
    else:
        raise OperationError(f"{path} was a {before['kind']}, which cannot be restored")


def link_atomically(target: Target, path: str, to: str, root: bool) -> None:
    """Make or replace a symbolic link in one rename, so that it is never missing."""
    script = f"""
set -u
{SAFE_PATHS}
enter_folder {quote(path)} || exit 1
new=$(mktemp -u -- "./$name.lupin-XXXXXXXX") || exit 1
trap 'rm -f -- "$new"' EXIT
ln -sT -- {quote(to)} "$new" && mv -fT -- "$new" "./$name" || exit 1
sync . 2>/dev/null || :
"""
    change(target, script, f"link {path} to {to}", root=root)


def remove(target: Target, path: str, root: bool) -> None:
    """Remove a file or a link, if it exists."""
    script = (
        f'{SAFE_PATHS}[ -e "$(dirname -- {quote(path)})" ] || exit 0\nenter_folder {quote(path)} || exit 1\nrm -f -- "./$name"'
    )
    change(target, script, f"remove {path}", root=root)


def put_owned(target: Target, path: str, data: bytes, mode: int, owner: str, root: bool) -> None:
    """Write a file that belongs to `owner` (user:group), or to the writer if that is empty."""
    if root:
        target.put(path, data, mode=mode, owner=owner, root=True)
        return
    target.put(path, data, mode=mode)
    if owner:
        set_attributes(target, path, owner=owner)


def set_attributes(target: Target, path: str, *, mode: str = "", owner: str = "", root: bool = False) -> None:
    """Set the mode (octal) and the owner (user:group) of a file or a folder, if they are given. Root follows no link."""
    lines = [SAFE_PATHS, f"enter_folder {quote(path)} && open_item || exit 1"]
    if owner:  # first, because it clears the bits setuid and setgid
        lines.append(f'[ "$(stat -L -c %U:%G -- "$item")" = {quote(owner)} ] || chown -- {quote(owner)} "$item" || exit 1')
    if mode:
        lines.append(f'chmod {mode} -- "$item"')
    wanted = " and ".join(filter(None, (f"the mode {mode}" if mode else "", f"the owner {owner}" if owner else "")))
    change(target, "\n".join(lines), f"give {path} {wanted}", root=root)


def unified_diff(path: str, old: bytes | None, new: bytes | None) -> str:
    """Return the unified diff of two contents, or one sentence if they are not text. None stands for no file."""
    try:
        before, after = (None if data is None else data.decode() for data in (old, new))
    except UnicodeDecodeError:
        return f"{path}: not text; {len(old or b'')} bytes before, {len(new or b'')} after"
    lines = difflib.unified_diff(
        (before or "").splitlines(), (after or "").splitlines(), "/dev/null" if old is None else path,
        "/dev/null" if new is None else path, lineterm="",
    )  # fmt: skip
    return "\n".join(lines)
