"""The page in Chromium: its size, how fast it opens, frames, scripting, memory, the stop, the stick, and the run beside it.

`load` opens the page of a run in new browsers. `stop` moves the stick, and presses the stop while a key drives: times are from
the event in the browser to the sink. `map` and `scene` watch a mission on the map from above and in 3-D; the simulator's pace
and the memory of all processes but the browser are measured too. The browser has the lowest priority: it takes only what the
run leaves. `log` measures, without a browser, how fast the page takes in lines of the log. `--seconds 1800 --only map` measures
the growth of the heap over half an hour, and `--seconds 420 --only stop` presses the stop 60 times.
"""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench.detached_run import detached_run
from bench.processes import spinning_node
from bench.runner import Figures, Only, Seconds, World, benchmark
from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from lupin_runtime.ros import LupinNode
from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.usage import descendants_by_pid, memory_mb
from tools.build_page import PAGE, WEB, find_chromium, install_packages, node_path

_SCENE_CHUNK = re.compile(r"map_scene-[\w-]+\.js")
_PROBE_MARGIN_S = 180.0
_MOVING_TIMEOUT_S = 60.0
_ANSWER_WITHIN_MS = 2000.0
_INTAKES = ("log store", "list copied for every line")  # as in web/bench/log_intake.bench.ts, and so are the lines
_INTAKE_LINES = 10_000


def gzip_kb(path: str) -> float:
    """Return the size of a file of the built page after gzip."""
    return (PAGE / f"{path.removeprefix('/page/')}.gz").stat().st_size / 1e3


def size() -> dict[str, float]:
    """Return the sizes of what the map needs before it is shown, and of the chunk that draws it in 3-D."""
    loaded: set[str] = set()
    waiting = re.findall(r'"/page/(assets/[^"]+\.(?:js|css))"', (PAGE / "index.html").read_text(encoding="utf-8"))
    waiting += [f"assets/{path.name}" for path in (PAGE / "assets").glob("map_tab-*.js")]
    while waiting:
        path = waiting.pop()
        if path not in loaded:
            loaded.add(path)
            text = (PAGE / path).read_text(encoding="utf-8") if path.endswith(".js") else ""
            waiting += [f"assets/{name}" for name in re.findall(r'(?:from|import)\s*"\./([^"]+\.js)"', text)]
    scene = next(path.name for path in (PAGE / "assets").glob("*.js") if _SCENE_CHUNK.fullmatch(path.name))
    assert f"assets/{scene}" not in loaded
    [dutch] = (PAGE / "assets").glob("dutch-*.js")
    return {
        "before_3d_kb": sum(map(gzip_kb, loaded)),
        "more_in_dutch_kb": gzip_kb(f"assets/{dutch.name}"),
        "scene_chunk_kb": gzip_kb(f"assets/{scene}"),
    }


def probe(part: str, run: Run, seconds: float) -> Any:
    """Run one part of the probe in a browser with the lowest priority; return what it printed."""
    described = read_description(run.path)
    if described is None:
        raise SystemExit(f"the console is not running; see: lupin logs console --run {run.id}")
    chromium = find_chromium()
    if chromium is None:
        raise SystemExit("this needs Chromium: apt-get install chromium")
    path = node_path()
    install_packages(path)
    done = subprocess.run(
        ["node", "bench/probe.mjs", part, described.url.rstrip("/"), str(seconds)],
        cwd=WEB,
        env={**os.environ, "PATH": path, "LUPIN_CHROMIUM": chromium},
        stdout=subprocess.PIPE,
        text=True,
        timeout=seconds + _PROBE_MARGIN_S,
        check=True,
        preexec_fn=lambda: os.nice(19),
    )
    return json.loads(done.stdout)


def log_intake() -> dict[str, float]:
    """Return how fast the page's store of the log takes in lines, and how much faster than a list copied for every line."""
    path = node_path()
    install_packages(path)
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = ["node_modules/.bin/vitest", "bench", "--run", "--outputJson", str(report), "bench/log_intake.bench.ts"]
        subprocess.run(
            command, cwd=WEB, env={**os.environ, "PATH": path}, stdout=sys.stderr, timeout=_PROBE_MARGIN_S, check=True
        )
        [group] = json.loads(report.read_text(encoding="utf-8"))["files"][0]["groups"]
    store, copied = (next(each["median"] for each in group["benchmarks"] if each["name"] == name) for name in _INTAKES)
    return {"log_lines_per_s": _INTAKE_LINES * 1e3 / store, "log_times_faster_than_copying": copied / store}


def load(run: Run) -> dict[str, float]:
    """Return the medians of several openings of the page in new browsers."""
    openings = probe("load", run, 0.0)["openings"]
    names = ("first_paint_ms", "interactive_ms", "robot_ms")
    figures = {name: statistics.median(opening[name] for opening in openings) for name in names}
    return {**figures, "loaded_kb": sum(map(gzip_kb, openings[0]["files"]))}


def watch(run: Run, part: str, seconds: float) -> dict[str, float]:
    """Watch the map during a mission; return what it costs the browser, and how the run keeps up."""
    name = "map" if part == "map" else "scene"
    with watched_run(run) as beside:
        seen = probe(part, run, seconds)
    heap = [each["heap_mb"] for each in seen["heap"]]
    third = max(1, len(heap) // 3)
    return {
        f"{name}_fps": seen["fps"],
        f"{name}_scripting_percent": seen["scripting_percent"],
        f"{name}_main_thread_percent": seen["main_thread_percent"],
        f"{name}_heap_mb": statistics.mean(heap[-third:]),
        f"{name}_heap_growth_mb": statistics.mean(heap[-third:]) - statistics.mean(heap[:third]),
        f"{name}_real_time_factor": beside["real_time_factor"],
        f"{name}_run_mb": beside["mb"],
    }


@contextmanager
def watched_run(run: Run) -> Iterator[dict[str, float]]:
    """Measure the simulator's pace and the peak memory of a run's processes for the time of a block."""
    figures = {"mb": 0.0}
    over = threading.Event()

    def follow_memory() -> None:
        supervisor = run.info()["pid"]
        while not over.wait(2.0):
            pids = [supervisor, *descendants_by_pid()(supervisor)]
            figures["mb"] = max(figures["mb"], sum(memory_mb(pid) or 0.0 for pid in pids))

    follower = threading.Thread(target=follow_memory)
    before = simulated_and_wall_s(run)
    follower.start()
    try:
        yield figures
    finally:
        over.set()
        follower.join()
    after = simulated_and_wall_s(run)
    figures["real_time_factor"] = (after[0] - before[0]) / (after[1] - before[1])


def simulated_and_wall_s(run: Run) -> tuple[float, float]:
    """Return how long the simulator has run, in simulated and in wall-clock time."""
    state = json.loads((run.path / "sim_state.json").read_text())
    return state["sim_time_s"], state["wall_time_s"]


def wait_for_motion(run: Run) -> None:
    """Wait until the mission drives."""
    deadline_s = time.monotonic() + _MOVING_TIMEOUT_S
    while max(map(abs, json.loads((run.path / "sim_state.json").read_text())["twist"])) < 0.05:
        if time.monotonic() > deadline_s:
            raise SystemExit(f"the mission did not drive within {_MOVING_TIMEOUT_S:.0f} s; see: lupin status")
        time.sleep(0.2)


class Sink:
    """Records when the sink changed between zero and motion, in ms of the wall clock, which the browser's events have too."""

    def __init__(self, node: LupinNode) -> None:
        self.changes: list[tuple[float, bool]] = []  # time, and whether the sink moves from then on
        node.subscription(graph.CMD_VEL_SINK_SIM, self._receive)

    def _receive(self, message: Any) -> None:
        moves = bool(message.linear.x or message.linear.y or message.angular.z)
        if not self.changes or self.changes[-1][1] != moves:
            self.changes.append((time.time() * 1e3, moves))

    def answers_ms(self, events: list[float], moves: bool) -> list[float]:
        """Return how long after each event the sink changed as it should. Exits if an event had no effect."""
        times_ms = []
        for event in events:
            before = [state for at, state in self.changes if at <= event]
            after = next((at for at, state in self.changes if at > event and state == moves), None)
            if before[-1:] != [not moves] or after is None or after - event > _ANSWER_WITHIN_MS:
                raise SystemExit(f"an event of the browser did not change the sink to {'motion' if moves else 'zero'}")
            times_ms.append(after - event)
        return times_ms


def stop(run: Run, seconds: float) -> dict[str, float]:
    """Return how fast the sink follows the stop and the stick of a browser."""
    with spinning_node("bench_page") as node:
        sink = Sink(node)
        noted = probe("stop", run, seconds)
    stops, sticks = sink.answers_ms(noted["presses"], False), sink.answers_ms(noted["moves"], True)
    return {
        "presses": len(stops),
        "stop_to_sink_median_ms": statistics.median(stops),
        "stop_to_sink_p99_ms": statistics.quantiles(stops, n=100, method="inclusive")[98],
        "stick_to_sink_median_ms": statistics.median(sticks),
    }


@benchmark(
    at_most={
        "before_3d_kb": 280.0,
        "scene_chunk_kb": 320.0,
        "first_paint_ms": 1000.0,
        "interactive_ms": 1500.0,
        "map_scripting_percent": 30.0,
        "map_heap_growth_mb": 5.0,
        "scene_scripting_percent": 30.0,
        "scene_heap_growth_mb": 5.0,
        "stop_to_sink_p99_ms": 100.0,
        "stick_to_sink_median_ms": 80.0,
        "map_run_mb": 1200.0,
        "scene_run_mb": 1200.0,
    },
    # Factors of 1, to two places.
    at_least={
        "map_fps": 30.0,
        "scene_fps": 30.0,
        "map_real_time_factor": 0.995,
        "scene_real_time_factor": 0.995,
        "log_lines_per_s": 20_000.0,
    },
)
def main(seconds: Seconds = 60.0, only: Only = "", world: World = "demo") -> Figures:
    """Measure the parts `size`, `log`, `load`, `stop`, `map` and `scene`."""
    parts = [name for name in ("size", "log", "load", "stop", "map", "scene") if re.search(only, name)]
    figures: dict[str, float] = size() if "size" in parts else {}
    figures |= log_intake() if "log" in parts else {}
    if {"load", "stop"} & set(parts):
        with detached_run(["--world", world, "--no-record"]) as run:
            figures |= load(run) if "load" in parts else {}
            figures |= stop(run, seconds) if "stop" in parts else {}
    if {"map", "scene"} & set(parts):
        with detached_run(["--world", world, "--mission", "--sweeps", "0"]) as run:  # a mission of any length
            for part in ("map", "scene"):
                if part in parts:
                    wait_for_motion(run)
                    figures |= watch(run, part, seconds)
    return figures


if __name__ == "__main__":
    sys.exit(main())
