"""Plays a playbook on this machine, and kills itself before or after it writes the n-th line of the journal."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import play
from lupin_cli.playbook.journal import Journal


def main(playbook: str, root: str, journal: str, kill_at: int, after: bool) -> None:
    write, lines = Journal.write, 0

    def write_and_die(self: Journal, event: str, **values: Any) -> None:
        nonlocal lines
        lines += 1
        if lines == kill_at and not after:
            os.kill(os.getpid(), signal.SIGKILL)
        write(self, event, **values)
        if lines == kill_at and after:
            os.kill(os.getpid(), signal.SIGKILL)

    Journal.write = write_and_die  # type: ignore[method-assign]
    play(Path(playbook), {"robot": LocalTarget("robot")}, {"root": root}, journal=Path(journal))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]), sys.argv[5] == "after")
