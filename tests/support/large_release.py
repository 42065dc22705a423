"""`lupin` with a release that has large files, so that its transfer takes a while. Tests run this module as a program.

    large_release.py FOLDER SIGNAL WORDS...

Adds the files of FOLDER to the release, and runs `lupin WORDS`. If SIGNAL is not empty, the program sends itself this signal
(such as SIGSTOP) during the transfer of the first archive.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from lupin_cli.release.contents import RobotPlatform, release_files

SIGNAL_DELAY_S = 0.05  # after the transfer of the first archive has started; it takes longer


def with_large_files(folder: Path) -> Callable[[RobotPlatform], Iterator[tuple[str, str | bytes]]]:
    """Return a replacement for `release_files` that adds the files of `folder`."""

    def files(robot: RobotPlatform) -> Iterator[tuple[str, str | bytes]]:
        yield from release_files(robot)
        for path in sorted(folder.iterdir()):
            yield f"share/{path.name}", str(path)

    return files


def main(folder: str, signal_name: str, *words: str) -> None:
    """Run `lupin WORDS` as described above."""
    from lupin_cli.app import app
    from lupin_cli.connection.ssh import SshTarget
    from lupin_cli.operations import release

    release.release_files = with_large_files(Path(folder))  # type: ignore[assignment, attr-defined]
    run = SshTarget.run

    def run_with_signal(self: SshTarget, script: str, **options: Any) -> Any:
        if script.startswith("tar ") and signal_name:
            threading.Timer(SIGNAL_DELAY_S, os.kill, (os.getpid(), signal.Signals[signal_name])).start()
        return run(self, script, **options)

    SshTarget.run = run_with_signal  # type: ignore[method-assign]
    app(list(words))


if __name__ == "__main__":
    main(*sys.argv[1:])
