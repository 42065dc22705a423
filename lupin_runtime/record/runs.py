"""Finds a recorded run by the name that an operator types, and opens its recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.bounded_file import expand_home, is_file, is_folder
from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.record.rosbag2 import METADATA, find_bag_files
from lupin_runtime.stack.runs import LATEST, RunError, all_runs, choose_run

RECORDING_NAME = "recording.mcap"


class RecordingNotFound(LookupError):
    """No recorded run and no file has this name; the message lists the candidates."""


@dataclass(frozen=True)
class RecordedRun:
    """A run directory or a rosbag2 folder with its recordings, or a single recording whose report is written beside it.

    `problems` are sentences about what the folder lacks.
    """

    folder: Path
    recordings: tuple[Path, ...]
    problems: tuple[str, ...] = ()

    @property
    def report_folder(self) -> Path:
        """The folder of the run's report."""
        return self.folder / "report"

    def open(self) -> list[Recording]:
        """Open the run's recordings, oldest first; a restarted recorder leaves more than one.

        Unreadable files are skipped; see `damage`. Raises NotARecording where none is readable.
        """
        opened, errors = self._try()
        if not opened:
            missing = f"{self.folder} holds no recording: neither {RECORDING_NAME} nor what `ros2 bag record -s mcap` writes"
            raise NotARecording("; ".join([*self.problems, *errors]) or missing)
        return opened

    def damage(self) -> list[str]:
        """Return what the folder lacks, and which of its files cannot be opened."""
        return [*self.problems, *self._try()[1]]

    def _try(self) -> tuple[list[Recording], list[str]]:
        opened, errors = [], []
        for path in self.recordings:
            try:
                opened.append(Recording(path))
            except NotARecording as error:
                errors.append(str(error))
        return opened, errors


def recorded_run(folder: Path) -> RecordedRun:
    """The run in `folder`, of Lupin or of rosbag2; `recordings` is empty where nothing was recorded."""
    stem = Path(RECORDING_NAME).stem
    first = folder / RECORDING_NAME
    later = sorted(folder.glob(f"{stem}-*.mcap"), key=lambda path: (len(path.name), path.name))
    if first.exists() or later:
        return RecordedRun(folder, tuple([first] if first.exists() else []) + tuple(later))
    bag = find_bag_files(folder)
    return RecordedRun(folder, bag.files, bag.problems)


def run_at(path: Path) -> RecordedRun | None:
    """The run in a folder, or of a single recording; None if there is no such file or folder."""
    if is_file(path) and path.name == METADATA:
        path = path.parent
    if is_file(path):
        stem = Path(path.name.removesuffix(".zstd").removesuffix(".lz4")).stem
        return RecordedRun(path.resolve().parent / f"{stem}-report", (path.resolve(),))
    return recorded_run(path.resolve()) if is_folder(path) else None


def find_recorded_run(name: str, folder: Path | None = None) -> RecordedRun:
    """Find a recorded run by the path of a recording or run directory, or by its name (see `choose_run`).

    `latest` is the newest run that was recorded. `folder` replaces the folder of all runs. Raises RecordingNotFound.
    """
    if (there := run_at(expand_home(name))) is not None:
        return there
    runs = all_runs(folder)
    recorded = [run for run in runs if recorded_run(run.path).recordings]
    if not recorded:
        raise RecordingNotFound(f"{name}: there is no such file, and no run was recorded yet; try: lupin up --mission")
    try:
        return recorded_run(choose_run(name, recorded if name == LATEST else runs).path)
    except RunError as error:
        raise RecordingNotFound(f"there is no file {name}, and {error}") from error
