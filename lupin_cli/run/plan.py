"""What `lupin up` would start, for `--dry-run`."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping

from lupin_cli.safe_console import SafeConsole
from lupin_runtime.stack.engines import describe
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.table import rows


def show_plan(options: Options, unavailable: Mapping[str, str], as_json: bool) -> None:
    """Print the processes of a run with these options, in the order of the table, and the parts that cannot be started."""
    processes = [
        {
            "name": row.name,
            "engine": describe(row.system.engine, os.environ) if row.engine and row.system is not None else "",
            "started": not row.external,
            "flag": row.flag,
        }
        for row in rows(options)
    ]
    if as_json:
        print(json.dumps({"target": options.target, "processes": processes, "not_started": dict(unavailable)}))
        return
    console = SafeConsole()
    for process in processes:
        verb = "would start" if process["started"] else "would wait for"
        engine = f" ({process['engine']})" if process["engine"] else ""
        console.print(f"{verb} {process['name']}{engine}", soft_wrap=True)
