"""Finds a recorded run by the name that an operator types, and opens its recordings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.stack.runs import runs_directory

RECORDING_NAME = "recording.mcap"
LATEST = "latest"


class RecordingNotFound(LookupError):
    """No recorded run and no file has this name; the message lists the candidates."""


@dataclass(frozen=True)
class RecordedRun:
    """A run directory with its recordings, or a single recording whose report is written beside it."""

    folder: Path
    recordings: tuple[Path, ...]

    @property
    def report_folder(self) -> Path:
        """The folder of the run's report."""
        return self.folder / "report"

    def open(self) -> list[Recording]:
        """Open the run's recordings, oldest first; a restarted recorder leaves more than one.

        Unreadable files are skipped. Raises NotARecording where none is readable.
        """
        opened, errors = [], []
        for path in self.recordings:
            try:
                opened.append(Recording(path))
            except NotARecording as error:
                errors.append(error)
        if not opened:
            raise errors[0] if errors else NotARecording(f"{self.folder} holds no recording ({RECORDING_NAME})")
        return opened


def recorded_run(folder: Path) -> RecordedRun:
    """The run in `folder`; `recordings` is empty where nothing was recorded."""
    stem = Path(RECORDING_NAME).stem
    first = folder / RECORDING_NAME
    later = sorted(folder.glob(f"{stem}-*.mcap"), key=lambda path: (len(path.name), path.name))
    return RecordedRun(folder, tuple([first] if first.exists() else []) + tuple(later))


def find_recorded_run(name: str, folder: Path | None = None) -> RecordedRun:
    """Find a recorded run by the path of a recording or run directory, by a run's id or the start of one, or by `latest`.

    `folder` replaces the folder of all runs. Raises RecordingNotFound.
    """
    path = Path(name).expanduser()
    if path.is_file():
        return RecordedRun(path.resolve().parent / f"{path.stem}-report", (path.resolve(),))
    if path.is_dir():
        return recorded_run(path.resolve())
    runs = sorted(_recorded(folder or runs_directory()), key=lambda run: run.recordings[-1].stat().st_mtime)
    if not runs:
        raise RecordingNotFound(f"{name}: there is no such file, and no run was recorded yet; try: lupin up --mission")
    if name == LATEST:
        return runs[-1]
    matching = [run for run in runs if run.folder.name.startswith(name)]
    exact = [run for run in matching if run.folder.name == name]
    if len(exact or matching) == 1:
        return (exact or matching)[0]
    newest = ", ".join(run.folder.name for run in reversed(matching or runs[-5:]))
    problem = f"{len(matching)} runs begin with it" if matching else "no file and no run has this name"
    raise RecordingNotFound(f"{name}: {problem}; {'they are' if matching else 'the newest are'}: {newest}")


def _recorded(folder: Path) -> Iterator[RecordedRun]:
    if folder.is_dir():
        for path in folder.iterdir():
            run = recorded_run(path)
            if path.is_dir() and run.recordings:
                yield run
