"""Message definitions for MCAP schemas of encoding `ros2msg`: the type itself, followed by all types that it contains.

The text is the installed `share/<package>/msg/<Name>.msg`. Where a package was installed without it, it is rebuilt from the
generated class, which lacks only constants and comments.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

# https://mcap.dev/spec/registry#ros2msg: 80 equals signs, then the resource name of the definition that follows.
_DELIMITER = "\n" + "=" * 80 + "\nMSG: {name}\n"

_PRIMITIVES = frozenset(
    [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
    + ["bool", "byte", "char", "float32", "float64", "string", "wstring"]
)
# Their different names in generated classes.
_CLASS_NAMES = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}

FieldTypes = Callable[[str], Mapping[str, str]]


class DefinitionMissing(LookupError):
    """The definition of a message type is not on this machine."""


def share_folders() -> list[Path]:
    """The folders of message definitions: those of a sourced ROS, then this Python's own."""
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    return [prefix / "share" for prefix in [*prefixes, Path(sys.prefix)]]


def schema_text(type_name: str, shares: Iterable[Path] | None = None, fields: FieldTypes | None = None) -> str:
    """The concatenated definition of `package/msg/Name`.

    `fields` returns a class's field types where no share folder has the definition. Raises DefinitionMissing.
    """
    folders = list(share_folders() if shares is None else shares)
    package, _, name = type_name.split("/")
    parts: list[str] = []
    seen = {(package, name)}
    queue = [(package, name)]
    while queue:
        package, name = queue.pop(0)
        text = _text(package, name, folders, fields)
        parts.append(text if not parts else _DELIMITER.format(name=f"{package}/{name}") + text)
        for dependency in _dependencies(text, package):
            if dependency not in seen:
                seen.add(dependency)
                queue.append(dependency)
    return "".join(parts)


def _text(package: str, name: str, folders: Iterable[Path], fields: FieldTypes | None) -> str:
    for folder in folders:
        path = folder / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    if fields is None:
        raise DefinitionMissing(f"no share/{package}/msg/{name}.msg on this machine; install {package}")
    lines = (f"{_class_type(kind)} {field}" for field, kind in fields(f"{package}/msg/{name}").items())
    return "".join(f"{line}\n" for line in lines)


def _class_type(kind: str) -> str:
    """Convert a field type of a generated class, e.g. `sequence<double, 3>` to `float64[<=3]`."""
    if match := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", kind):
        return f"{_class_type(match[1])}[{'<=' + match[2] if match[2] else ''}]"
    if match := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        return f"{_class_type(match[1])}[{match[2]}]"
    if match := re.fullmatch(r"(w?string)<(\d+)>", kind):
        return f"{match[1]}<={match[2]}"
    return _CLASS_NAMES.get(kind, kind)


def _dependencies(text: str, package: str) -> list[tuple[str, str]]:
    """(package, name) of every message type that a definition contains."""
    found = []
    for line in text.splitlines():
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        kind = re.split(r"[\[<]", words[0], maxsplit=1)[0]
        if kind in _PRIMITIVES:
            continue
        *owner, name = kind.split("/")
        found.append((owner[0] if owner else package, name))
    return found
