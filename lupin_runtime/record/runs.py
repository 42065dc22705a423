"""Finds a recorded run by the name that an operator types, and opens its recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.bounded_file import expand_home, is_file, is_folder
from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.stack.runs import LATEST, RunError, all_runs, choose_run

RECORDING_NAME = "recording.mcap"


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
    """Find a recorded run by the path of a recording or run directory, or by its name (see `choose_run`).

    `latest` is the newest run that was recorded. `folder` replaces the folder of all runs. Raises RecordingNotFound.
    """
    path = expand_home(name)
    if is_file(path):
        return RecordedRun(path.resolve().parent / f"{path.stem}-report", (path.resolve(),))
    if is_folder(path):
        return recorded_run(path.resolve())
    runs = all_runs(folder)
    recorded = [run for run in runs if recorded_run(run.path).recordings]
    if not recorded:
        raise RecordingNotFound(f"{name}: there is no such file, and no run was recorded yet; try: lupin up --mission")
    try:
        return recorded_run(choose_run(name, recorded if name == LATEST else runs).path)
    except RunError as error:
        raise RecordingNotFound(f"there is no file {name}, and {error}") from error
