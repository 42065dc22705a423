"""Finds the files of a folder that `ros2 bag record` wrote, as rosbag2's readers do.

Its metadata.yaml lists them in their order (rosbag2_storage, `relative_file_paths`). A recorder that was killed wrote none, and
then the files are those of the folder, in the order of the numbers that rosbag2 gives to splits.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from lupin_runtime.bounded_file import is_file, read_bounded_text
from lupin_runtime.yaml_text import load_yaml, where_and_why

METADATA = "metadata.yaml"
_ROOT = "rosbag2_bagfile_information"
_PARENT_VERSION = 4  # before this version, paths begin with the folder's own name
_SPLIT = re.compile(r"(?P<stem>.*?)(?:_(?P<number>\d+))?\.mcap(?:\.zstd|\.lz4)?\Z", re.DOTALL)
_UNPACKED = re.compile(r"(\.mcap)\.(zstd|lz4)\Z")


@dataclass(frozen=True)
class BagFiles:
    """The files of a folder, oldest first, and what is wrong with it: sentences for the operator."""

    files: tuple[Path, ...] = ()
    problems: tuple[str, ...] = ()


def find_bag_files(folder: Path) -> BagFiles:
    """Return the files of a rosbag2 folder; without any, `problems` says why, or is empty if there is nothing of rosbag2."""
    problem = ""
    if is_file(folder / METADATA):
        try:
            return _listed(folder, _read(folder / METADATA))
        except ValueError as error:
            problem = f"{folder / METADATA}: {error}; the files are taken in the order of their numbers"
    found = _in_folder(folder)
    return BagFiles(found.files, (problem, *found.problems) if problem else found.problems)


def _read(path: Path) -> dict[str, Any]:
    """Return the information in metadata.yaml. Raises ValueError."""
    try:
        document = load_yaml(read_bounded_text(path))
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from error
    except yaml.YAMLError as error:
        line, problem = where_and_why(error)
        raise ValueError(f"{f'line {line}: ' if line is not None else ''}is {problem}") from error
    information = document.get(_ROOT) if isinstance(document, dict) else None
    paths = information.get("relative_file_paths") if isinstance(information, dict) else None
    if not isinstance(paths, list) or not paths or not all(isinstance(name, str) and name for name in paths):
        raise ValueError(f"expected {_ROOT} with the list relative_file_paths")
    return dict(information or {})


def _listed(folder: Path, information: dict[str, Any]) -> BagFiles:
    storage = information.get("storage_identifier", "mcap")
    if storage != "mcap":
        return BagFiles((), (_not_mcap(folder, f"{storage!s:.40}"),))
    mode, packed_by = (str(information.get(key) or "").lower() for key in ("compression_mode", "compression_format"))
    if mode == "message" and packed_by not in ("zstd", ""):
        problem = f"{folder}: its messages are compressed by {packed_by!r:.40}, of which only zstd is read; record it without"
        return BagFiles((), (problem,))
    version = information.get("version")
    files, problems = [], []
    for name in information["relative_file_paths"]:
        file = folder / name  # an absolute path stays
        places = [file, file.with_name(_UNPACKED.sub(r"\1", file.name))]
        if isinstance(version, int) and version < _PARENT_VERSION:
            places.append(folder.parent / name)
        found = next((place for place in places if is_file(place)), None)
        if found is None:
            problems.append(f"{file}: no such file, but {METADATA} lists it; its part of the recording is missing")
        else:
            files.append(found)
    return BagFiles(tuple(files), tuple(problems))


def _in_folder(folder: Path) -> BagFiles:
    try:
        names = sorted(path.name for path in folder.iterdir())
    except OSError:
        return BagFiles()
    found = {name: match for name in names if (match := _SPLIT.match(name)) and is_file(folder / name)}
    if not found:
        return BagFiles((), (_not_mcap(folder, "sqlite3"),) if any(".db3" in name for name in names) else ())
    stems = {match["stem"] for match in found.values()}
    if len(stems) > 1:
        shown = ", ".join(sorted(found)[:5]) + (", ..." if len(found) > 5 else "")
        return BagFiles((), (f"{folder} holds {len(found)} recordings and no {METADATA}; name one of them: {shown}",))
    ordered = sorted(found, key=lambda name: int(found[name]["number"] or 0))
    return BagFiles(tuple(folder / name for name in ordered))


def _not_mcap(folder: Path, storage: str) -> str:
    return (
        f"{folder} is a rosbag2 recording in the storage {storage}, and only mcap is read; convert it with: "
        f"ros2 bag convert -i {folder} -o mcap.yaml, where mcap.yaml holds: "
        f"output_bags: [{{uri: {folder.name}-mcap, storage_id: mcap, all_topics: true}}]"
    )
