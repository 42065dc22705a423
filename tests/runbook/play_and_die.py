"""Plays a playbook on this machine and is killed at the n-th line of its journal, before or after it is written."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

from lupin_cli.runbook import play
from lupin_cli.runbook.journal import Journal
from lupin_cli.target.local import LocalTarget


def main(book: str, root: str, journal: str, at: int, after: bool) -> None:
    write, count = Journal.write, 0

    def counted(self: Journal, event: str, **values: Any) -> None:
        nonlocal count
        count += 1
        if count == at and not after:
            os.kill(os.getpid(), signal.SIGKILL)
        write(self, event, **values)
        if count == at and after:
            os.kill(os.getpid(), signal.SIGKILL)

    Journal.write = counted  # type: ignore[method-assign]
    play(Path(book), {"robot": LocalTarget("robot")}, {"root": root}, journal=Path(journal))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]), sys.argv[5] == "after")
