"""One process of the stack: `python -m lupin_runtime.stack.process FILE.json`.

The file names the node classes and their parameters. The process ends when its standard input does: that is how the
death of the supervisor, however sudden, reaches it.
"""

from __future__ import annotations

import faulthandler
import gc
import importlib
import json
import os
import sys
from functools import partial
from pathlib import Path
from typing import Any


def node_class(path: str) -> Any:
    """The class of `package.module:Class`."""
    module, name = path.split(":")
    return getattr(importlib.import_module(module), name)


def main(argument: str) -> int:
    """Run the nodes of a process file until told to stop; returns the exit status."""
    faulthandler.enable()
    config = json.loads(Path(argument).read_text())
    from lupin_runtime.ros import run
    from lupin_runtime.ros.parent import end_with_parent

    end_with_parent()

    factories = [partial(node_class(node["class"]), node.get("parameters") or {}) for node in config["nodes"]]
    # What was imported lives as long as the process: full collections need not walk it.
    gc.collect()
    gc.freeze()
    return run(factories, simulated_time=bool(config["simulated_time"]))


if __name__ == "__main__":
    status = main(sys.argv[1])
    sys.stdout.flush()
    sys.stderr.flush()
    # Interpreter shutdown after DDS is slow and may abort; everything worth keeping is written by now.
    os._exit(status)
