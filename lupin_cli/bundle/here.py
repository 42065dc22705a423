"""What this machine keeps of Lupin itself: inventory, the last run's logs, the last playbooks' journals, versions."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from lupin_cli import __version__
from lupin_cli.bundle import ends
from lupin_cli.bundle.pieces import ABSENT, UNREADABLE, LeftOut, Piece

JOURNALS = 10
FILE_LIMIT = 2_000_000
# Of a run: not its recording, which is large and is pictures of somebody's greenhouse.
RUN_FILES = ("run.json", "state.json", "result.json", "sim_state.json")
_TELLING = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "LUPIN_", "AMENT_", "CYCLONEDDS_", "XDG_")
_ALSO = ("PATH", "LANG", "LC_ALL", "TZ", "SHELL", "TERM", "LD_LIBRARY_PATH", "PYTHONPATH")


def lupin(options: dict[str, Any]) -> Piece:
    """Which Lupin on which platform, and what it was asked for."""
    installed = sorted({f"{each.name}=={each.version}" for each in importlib.metadata.distributions() if each.name})
    told = {
        "lupin": __version__,
        "options": options,
        "python": sys.version,
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "user_id": os.getuid(),
        "packages": installed,
        "environment": {k: v for k, v in sorted(os.environ.items()) if k in _ALSO or k.startswith(_TELLING)},
    }
    return Piece("laptop/lupin/lupin.json", "version, platform, packages, environment", told)


def of_lupin(config: Path, since_s: float | None) -> Iterator[Piece | LeftOut]:
    """Everything else of Lupin's on this machine."""
    yield file(config, "laptop/lupin/lupin.toml", "the inventory of robots")
    yield from last_run()
    yield from playbook_journals(since_s)


def file(path: Path, place: str, what: str) -> Piece | LeftOut:
    """One file of this machine."""
    try:
        found = ends.of_file(path, FILE_LIMIT)
    except FileNotFoundError:
        return LeftOut(place, ABSENT, f"there is no {path}")
    except OSError as error:
        return LeftOut(place, UNREADABLE, f"{path}: {error.strerror}")
    return Piece(place, what, found.data, f"{found.left_out} of its middle are left out" if found.left_out else "")


def last_run() -> Iterator[Piece | LeftOut]:
    """What the live run of `lupin up`, or else the last one, has said."""
    from lupin_runtime.stack.runs import RunError, find_run

    try:
        run = find_run()
    except RunError as error:
        yield LeftOut("laptop/run", ABSENT, str(error))
        return
    folder = f"laptop/run/{run.id}"
    for name in RUN_FILES:
        if (run.path / name).exists():
            yield file(run.path / name, f"{folder}/{name}", f"the last run: {name}")
    logs = sorted(run.logs.glob("*.log"))
    for log in logs:
        yield file(log, f"{folder}/logs/{log.name}", f"the last run: what {log.stem} said")
    if not logs:
        yield LeftOut(f"{folder}/logs", ABSENT, "no process of the run has written a log")
    if run.recording.exists():
        size = run.recording.stat().st_size
        yield LeftOut(f"{folder}/{run.recording.name}", "too big", f"{size} bytes of recording stay here: {run.recording}")


def playbook_journals(since_s: float | None) -> Iterator[Piece | LeftOut]:
    """The newest journals of `lupin play`, without what `undo` keeps of the files that were there before."""
    from lupin_cli.runbook.journal import journal_folder

    earliest = 0.0 if since_s is None else time.time() - since_s
    try:
        aged = [(path.stat().st_mtime, path) for path in journal_folder().glob("*.jsonl")]
    except OSError as error:
        yield LeftOut("laptop/playbooks", UNREADABLE, f"{journal_folder()}: {error.strerror}")
        return
    newest = [path for mtime, path in sorted(aged, reverse=True)[:JOURNALS] if mtime >= earliest]
    if not newest:
        yield LeftOut(
            "laptop/playbooks", ABSENT, f"no playbook was played{' in that time' if aged else ''}: {journal_folder()}"
        )
    for path in newest:
        found = file(path, f"laptop/playbooks/{path.name}", "what a playbook did")
        if isinstance(found, Piece):
            content, torn = without_before(found.content.splitlines())
            remark = "; ".join(filter(None, (found.remark, f"{torn} torn lines are left out" if torn else "")))
            found = Piece(found.path, found.what, content, remark)
        yield found


def without_before(lines: Iterable[bytes]) -> tuple[bytes, int]:
    """A journal's lines without the `before` that undo writes back, and how many lines could not be read.

    It holds whole files as they were, so what is in there may have no word beside it that tells a secret; the same goes for a
    line that was torn off within one.
    """
    kept, torn = [], 0
    for line in lines:
        try:
            event = json.loads(line)
        except ValueError:
            torn += bool(line.strip())
            continue
        if isinstance(event, dict) and "before" in event:
            event["before"] = "left out"
        kept.append(json.dumps(event, ensure_ascii=False).encode("utf-8", "surrogateescape") + b"\n")
    return b"".join(kept), torn
