"""Prints what each graph known to this machine contains, as JSON: `python -m lupin_runtime.stack.graph_probe`.

Each graph is joined by a separate process (`graph_session`), because a process's DDS mode is fixed when it starts.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from lupin_runtime.ending import exit_with
from lupin_runtime.exit_codes import SUCCESS, USAGE_ERROR
from lupin_runtime.interpreter import PYTHON
from lupin_runtime.json_text import parse_json
from lupin_runtime.stack.graph_session import probe_graph
from lupin_runtime.stack.known_graphs import KnownGraph, known_graphs

# Two visits, one after the other, on a busy machine.
PROBE_TIMEOUT_S = 35.0


def _start(environment: Mapping[str, str]) -> subprocess.Popen[str]:
    command = [*PYTHON, "-m", "lupin_runtime.stack.graph_probe", "--here"]
    return subprocess.Popen(command, env=dict(environment), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _finish(process: subprocess.Popen[str], deadline_s: float) -> dict[str, Any]:
    try:
        out, err = process.communicate(timeout=max(0.1, deadline_s - time.monotonic()))
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return {"error": f"the graph probe did not finish within {PROBE_TIMEOUT_S:.0f} s"}
    with suppress(ValueError):
        seen = parse_json(out)
        if isinstance(seen, dict):
            return seen
    last = (err.strip().splitlines() or ["no error output"])[-1]
    return {"error": f"the graph probe exited with status {process.returncode}: {last}"}


def _is_silent(seen: Mapping[str, Any]) -> bool:
    samples = seen.get("samples") or {}
    return bool(samples) and not any(sample["count"] for sample in samples.values())


def _may_use_shared_memory(environment: Mapping[str, str]) -> bool:
    """Return whether nodes on this machine may be in the graph: those of a robot's server elsewhere are reached over UDP."""
    host = environment.get("ROS_DISCOVERY_SERVER", "").split(";")[0].partition(":")[0]
    return "FASTDDS_BUILTIN_TRANSPORTS" not in environment and host in ("", "localhost", "127.0.0.1")


def probe_all(graphs: tuple[KnownGraph, ...]) -> list[dict[str, Any]]:
    """Probe all graphs at the same time.

    If names were seen but no sample arrived, a second probe without shared memory shows whether shared memory is the cause.
    """
    deadline_s = time.monotonic() + PROBE_TIMEOUT_S
    processes = [_start(known.environment) for known in graphs]
    results = []
    try:
        for known, process in zip(graphs, processes):
            seen = _finish(process, deadline_s)
            if _is_silent(seen) and _may_use_shared_memory(known.environment):
                again = _start({**known.environment, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"})
                processes.append(again)
                udp = _finish(again, deadline_s)
                if "error" not in udp:
                    seen["udp_heard"] = sum(bool(s["count"]) for s in udp["samples"].values())
            results.append(
                {
                    "name": known.name,
                    "kind": known.kind,
                    "environment": {key: known.environment[key] for key in SHOWN if key in known.environment},
                    **seen,
                }
            )
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()
    return results


SHOWN = (
    "ROS_DOMAIN_ID",
    "ROS_DISCOVERY_SERVER",
    "RMW_IMPLEMENTATION",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
)


def main(argv: list[str] | None = None) -> int:
    """Print one JSON object.

    `--here` probes only the graph of this process's environment. `--shell` also probes that graph if it is not a known one: it
    is the one that a ROS program joins which is started in the operator's shell.
    """
    arguments = sys.argv[1:] if argv is None else argv
    if arguments == ["--here"]:
        print(json.dumps(probe_graph()), flush=True)
        return SUCCESS
    if arguments not in ([], ["--shell"]):
        print(f"graph_probe: unknown arguments {arguments}; the only arguments are --here and --shell", file=sys.stderr)
        return USAGE_ERROR
    print(json.dumps({"graphs": probe_all(known_graphs(with_shell=bool(arguments)))}), flush=True)
    return SUCCESS


if __name__ == "__main__":
    exit_with(main())
