"""The recordings of a run, and how they are found by what an operator types."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.stack.runs import runs_directory

RECORDING_NAME = "recording.mcap"
LATEST = "latest"


class RunNotFound(LookupError):
    """No run and no file has this name; the message lists what there is."""


@dataclass(frozen=True)
class RunFiles:
    """A run directory, or a lone recording whose report then lies beside it."""

    folder: Path
    recordings: tuple[Path, ...]

    @property
    def report_folder(self) -> Path:
        """Where the run's report is."""
        return self.folder / "report"

    def open(self) -> list[Recording]:
        """The run's recordings, oldest first; a recorder that was restarted left more than one. Raises NotARecording.

        Files that are no recordings are an error only when nothing else is left.
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


def run_files(folder: Path) -> RunFiles:
    """The files of a run directory; `recordings` is empty where nothing was recorded."""
    stem = Path(RECORDING_NAME).stem
    first = folder / RECORDING_NAME
    later = sorted(folder.glob(f"{stem}-*.mcap"), key=lambda path: (len(path.name), path.name))
    return RunFiles(folder, tuple([first] if first.exists() else []) + tuple(later))


def find_run(name: str, folder: Path | None = None) -> RunFiles:
    """The run that `name` means: a recording, a run directory, a run's id or its beginning, or `latest`.

    Raises RunNotFound.
    """
    path = Path(name).expanduser()
    if path.is_file():
        return RunFiles(path.resolve().parent / f"{path.stem}-report", (path.resolve(),))
    if path.is_dir():
        return run_files(path.resolve())
    runs = sorted(_recorded(folder or runs_directory()), key=lambda run: run.recordings[-1].stat().st_mtime)
    if not runs:
        raise RunNotFound(f"{name}: there is no such file, and no run was recorded yet; try: lupin up --mission")
    if name == LATEST:
        return runs[-1]
    matching = [run for run in runs if run.folder.name.startswith(name)]
    exact = [run for run in matching if run.folder.name == name]
    if len(exact or matching) == 1:
        return (exact or matching)[0]
    newest = ", ".join(run.folder.name for run in reversed(matching or runs[-5:]))
    problem = f"{len(matching)} runs begin with it" if matching else "no file and no run has this name"
    raise RunNotFound(f"{name}: {problem}; {'they are' if matching else 'the newest are'}: {newest}")


def _recorded(folder: Path) -> Iterator[RunFiles]:
    if folder.is_dir():
        for path in folder.iterdir():
            run = run_files(path)
            if path.is_dir() and run.recordings:
                yield run
