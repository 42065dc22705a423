"""The arm: the time from a pad to its trajectories, from the loss of a process to rest, and the timing of a replay.

A simulated computer boots with the vendor's stack, whose robot is simulated, and Lupin's unit; `bench.arm_client` measures on
its graph. A jog begins with a pad's event: `event_to_trajectory` ends when the trajectory arrives, `jog_to_trajectory` is the
share of `body`, between the publication of rates and of the trajectory. The arm is at rest when it is, and stays, within
0.005 rad of where it is 3.5 s later, seen in joint states at 50 Hz. A replay of 800 waypoints pans from end to end in 40 s. Its
error is how much the time at which a waypoint is passed differs from the lag of the arm, which is the median. In
`replay.clock_step`, the robot's wall clock is set ahead by five minutes meanwhile, and back again.
"""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from bench import arm_client
from bench.booted import booted_operator
from bench.processes import child_command
from bench.runner import Figures, benchmark, note
from lupin_runtime.arm.store import LibraryStore
from tests.support.onboard_units import install_units, run_on_graph

UNIT = "lupin-onboard.service"
LIBRARY = "/home/mirte/.config/lupin/arm_library.json"
PLAYING = "/home/mirte/bench_arm_playing"
SIGNALS = ("KILL", "STOP")
PART_TIMEOUT_S = 140.0  # a command on the robot has 150 s
CLOCK_STEP_S, STEPPED_S = 300.0, 10.0
POLL_S = 0.5


def set_up(robot: Any) -> None:
    """Store the replay on the robot, and start Lupin's unit."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm_library.json"
        LibraryStore(path).put("sequence", arm_client.SEQUENCE, arm_client.sequence(), overwrite=False)
        folders = "/home/mirte/.config /home/mirte/.config/lupin"
        script = f"install -d -o mirte -g mirte {folders}; cat > {LIBRARY}; chown mirte:mirte {LIBRARY}; systemctl start {UNIT}"
        install_units(robot, (UNIT,))
        done = robot.run_as_root("sh", "-ec", script, stdin=path.read_text(), timeout_s=PART_TIMEOUT_S)
    if done.status != 0:
        raise SystemExit(f"not measured: {UNIT} did not start: {done.stderr}")


def measure(robot: Any, function: Callable[..., int], **arguments: Any) -> dict[str, Any]:
    """Call a function of the client on the robot, and return the figures that it prints."""
    done = run_on_graph(robot, child_command(function, **arguments), PART_TIMEOUT_S)
    if done.status != 0:
        raise SystemExit(f"not measured: {function.__name__} ended with {done.status}: {done.stderr[-2000:]}")
    figures: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    note(function.__name__, figures)
    return figures


def measure_replay_with_clock_step(robot: Any) -> dict[str, Any]:
    """Measure a replay during which the robot's clock is set ahead and back."""
    stepped = threading.Event()

    def step() -> None:
        deadline_s = time.monotonic() + PART_TIMEOUT_S
        while robot.run_as_root("rm", PLAYING).status != 0:
            if time.monotonic() > deadline_s:
                return
            time.sleep(POLL_S)
        with robot.with_fault("clock-wrong", offset_s=CLOCK_STEP_S):
            time.sleep(STEPPED_S)
        stepped.set()

    thread = threading.Thread(target=step, daemon=True)
    thread.start()
    figures = measure(robot, arm_client.measure_replay, playing=PLAYING)
    thread.join(STEPPED_S)
    if not stepped.is_set():
        raise SystemExit("not measured: the robot's clock was not set during the replay")
    return figures


def measure_rest(robot: Any, signal_: str, rounds: int) -> dict[str, float]:
    """Return how long the arm moves on in the slowest round (s), and how often a pad resumed its jog after a stop."""
    rows = [measure(robot, arm_client.measure_rest, signal_=signal_) for _ in range(rounds)]
    slowest = {f"{name}_s": max(row["at_rest_s"][name] for row in rows) for name in rows[0]["at_rest_s"]}
    return {**slowest, "resumed": sum(row["resumed"] for row in rows)}


@benchmark(
    at_most={
        "event_to_trajectory.p99_ms": 25.0,
        "event_to_trajectory.lost_share": 0.01,
        "jog_to_trajectory.p99_ms": 10.0,
        "jog_without_*_s": 1.0,
        "replay_without_*_s": 1.0,
        "resumed": 0,
        "replay.steady_clock.error.p99_ms": 20.0,
        "replay.clock_step.error.p99_ms": 20.0,
    }
)
def main(
    samples: Annotated[int, "jog this many times"] = 100,
    rounds: Annotated[int, "end each process in each way this many times"] = 2,
) -> Figures:
    """Measure everything on one robot."""
    with booted_operator(vendor_robot=True) as operator:
        robot = operator.host.robot
        set_up(robot)
        jog = measure(robot, arm_client.measure_jog, samples=samples)
        replay = {"steady_clock": measure(robot, arm_client.measure_replay, playing=PLAYING)}
        robot.run_as_root("rm", PLAYING)
        replay["clock_step"] = measure_replay_with_clock_step(robot)
        rest = {name: measure_rest(robot, name, rounds) for name in SIGNALS}
        return {**jog, "replay": replay, "rest": rest}


if __name__ == "__main__":
    sys.exit(main())
