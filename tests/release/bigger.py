"""A release with large files among its own, so that its copy takes a while; as a program, `lupin` with that release."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

AFTER_S = 0.05  # of the archive's journey, a fraction of it


def enlarge(folder: Path) -> Any:
    """The release's files with those of `folder` among them."""
    from lupin_cli.release.contents import files

    def bigger(robot: Any) -> Any:
        yield from files(robot)
        for path in sorted(folder.iterdir()):
            yield f"share/{path.name}", str(path)

    return bigger


def main(folder: str, number: str, *words: str) -> None:
    """`lupin WORDS` with that release. Where a signal is named, it sends that to itself in the middle of the first archive."""
    from lupin_cli.app import app
    from lupin_cli.operations import release
    from lupin_cli.target.ssh import SshTarget

    release.files = enlarge(Path(folder))
    run = SshTarget.run

    def stops(self: SshTarget, script: str, **options: Any) -> Any:
        if script.startswith("tar ") and number:
            threading.Timer(AFTER_S, os.kill, (os.getpid(), signal.Signals[number])).start()
        return run(self, script, **options)

    SshTarget.run = stops  # type: ignore[method-assign]
    app(list(words))


if __name__ == "__main__":
    main(*sys.argv[1:])
