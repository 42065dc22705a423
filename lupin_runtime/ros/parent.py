"""A process that ends when the one that started it does, however suddenly that was."""

from __future__ import annotations

import os
import signal
import stat
import threading
import time

ORPHAN_GRACE_S = 5.0


def end_with_parent(stream: int = 0) -> None:
    """Stop this process when the pipe `stream` reaches its end; kill it where stopping takes longer than the grace.

    A supervisor holds the other end of the standard input of its children, so the kernel tells them of its death. Anything
    but a pipe, a terminal say, is left alone.
    """
    try:
        if not stat.S_ISFIFO(os.fstat(stream).st_mode):
            return
    except OSError:
        return

    def watch() -> None:
        while os.read(stream, 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(ORPHAN_GRACE_S)
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()
