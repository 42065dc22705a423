"""One process of the stack: `python -m lupin_runtime.stack.process FILE.json`.

The file lists the node classes and their parameters; on a full disk, its content is the argument. The process exits when its
standard input is closed, which also happens when the supervisor is killed.
"""

from __future__ import annotations

import faulthandler
import gc
import importlib
import sys
from functools import partial
from pathlib import Path
from typing import Any

from lupin_runtime.ending import exit_with
from lupin_runtime.json_text import parse_json


def node_class(path: str) -> Any:
    """Import the class named by `package.module:Class`."""
    module, name = path.split(":")
    return getattr(importlib.import_module(module), name)


def main(argument: str) -> int:
    """Run the nodes of a process file until a signal or the end of standard input; return the exit status."""
    faulthandler.enable()
    config = parse_json(argument if argument.startswith("{") else Path(argument).read_text())
    from lupin_runtime.ros import run
    from lupin_runtime.ros.supervision import Supervision

    supervision = Supervision()
    supervision.start()

    factories = [partial(node_class(node["class"]), node.get("parameters") or {}) for node in config["nodes"]]
    # Imported objects live as long as the process. Frozen, they are not visited by every full garbage collection.
    gc.collect()
    gc.freeze()
    return run(factories, simulated_time=bool(config["simulated_time"]), supervision=supervision)


if __name__ == "__main__":
    exit_with(main(sys.argv[1]))
