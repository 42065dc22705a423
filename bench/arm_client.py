"""What `bench_arm` measures on the robot's graph: a jog from the pad to the trajectories, the arm's rest, and a replay.

It runs on the robot, beside Lupin's units, whose process `body` moves the arm. The pad is made of a pipe, and read by a process
of its own, as one that is connected to the robot is read by the process `joystick`.
"""

from __future__ import annotations

import json
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from bench.bench_drive import percentiles
from bench.bench_teleop import RESUME_S, start_pads
from bench.processes import kill, terminate
from lupin_runtime import graph
from lupin_runtime.arm.library import StoredSequence, Waypoint
from lupin_runtime.arm.messages import path_of
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.priority import request_realtime_scheduling
from lupin_runtime.stack.runs import live_runs
from lupin_runtime.stack.supervisor import RESTARTS_WITHIN_S
from lupin_runtime.teleop.events import BTN_EAST, BTN_NORTH, BTN_TL
from lupin_runtime.teleop.pad_state import SETTLE_S
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.graph_client import GraphClient
from tests.support.hang import is_replaced, process_state
from tests.support.pad_events import key

PAD, BODY = "event5", "body"
PAN_LEFT, PAN_RIGHT = BTN_EAST, BTN_NORTH  # of an Xbox pad
PAN = graph.ARM_JOINTS[0]
# The replay pans slowly from end to end: every waypoint is passed once, at a time that can be read from the pan's angle.
SEQUENCE, WAYPOINTS, STEP_S, END_RAD = "bench", 800, 0.05, 1.4
START_RAD = 1.3  # the pan's angle before it is jogged to the other side
HOLD_S, REST_S = 0.25, 0.35
SPEED_WINDOW_S = 0.2
MOTION_SEEN_S = SPEED_WINDOW_S + 0.1  # a motion that has just begun shows in the speed after this time
MOVING_RADPS = 0.05
AT_REST_RAD = 0.005
WATCH_S = 3.5  # for a motion that goes on, or that a restarted process resumes
BODY_TIMEOUT_S, MOVE_TIMEOUT_S = 40.0, 15.0
ANSWER_TIMEOUT_S = 3.0


def sequence() -> StoredSequence:
    """Return the motion that is replayed."""
    angles = np.linspace(-END_RAD, END_RAD, WAYPOINTS)
    waypoints = tuple(Waypoint(index * STEP_S, (float(pan), 0.0, 0.0, 0.0)) for index, pan in enumerate(angles))
    return StoredSequence("teleop", False, waypoints[-1].t, waypoints)


class ArmClient(GraphClient):
    """A client on the graph of the robot's units, with a pad. Times of messages are those of the middleware, in ns."""

    def __init__(self, run: Path, pads: FakePads) -> None:
        super().__init__(run, "bench_arm")
        self.pads = pads
        self.pans: list[tuple[float, float]] = []  # monotonic s, rad
        self.jogs: list[int] = []  # when each message that moves the arm was published
        self.trajectories: list[tuple[int, int]] = []  # when each was published, and when it was received
        self.paths: list[tuple[float, Any]] = []  # monotonic s, path
        self.resumed = 0  # messages that move the arm, of a pad's process that was stopped and continued
        on_jog: Callable[..., None] = self._on_jog
        on_trajectory: Callable[..., None] = self._on_trajectory
        self.node.subscription(graph.JOINT_STATES, self._on_joints, qos=graph.Qos(reliable=False, depth=50))
        self.node.subscription(graph.ARM_JOG, on_jog)
        self.node.subscription(graph.ARM_TRAJECTORY, on_trajectory)
        self.process = start_pads(pads)
        self.start()
        self.pads.plug(PAD, pad_ids.XBOX_USB)
        self.until(lambda: self.pans, "joint states")
        self.until(lambda: self.node.count_publishers(graph.ARM_JOG.name) > 1, "the pad's process")
        time.sleep(2 * SETTLE_S)
        self.release()

    def restart_pads(self) -> None:
        """Replace the pad's process by a new one, to which the pad is at rest."""
        kill(self.process)
        self.process = start_pads(self.pads)
        time.sleep(3 * SETTLE_S)
        self.release()

    def close(self) -> None:
        """End the pad's process, and leave the graph."""
        terminate(self.process, 5.0)
        super().close()

    # -- messages ------------------------------------------------------------------------------------------------------
    def _on_joints(self, message: Any) -> None:
        with suppress(ValueError):  # the wheels may be published in separate messages
            self.pans.append((time.monotonic(), message.position[list(message.name).index(PAN)]))

    def _on_jog(self, message: Any, info: dict[str, int]) -> None:
        if any(message.velocity):
            self.jogs.append(info["source_timestamp"])

    def _on_trajectory(self, message: Any, info: dict[str, int]) -> None:
        self.trajectories.append((info["source_timestamp"], info["received_timestamp"]))
        self.paths.append((time.monotonic(), path_of(message)))

    # -- the arm -------------------------------------------------------------------------------------------------------
    def press(self, code: int, value: int) -> None:
        """Press or release a button."""
        self.pads.send(PAD, key(code, value, time.monotonic_ns()))

    def release(self) -> None:
        """Let go of all buttons."""
        for code in (BTN_TL, PAN_LEFT, PAN_RIGHT):
            self.press(code, 0)

    def speed_radps(self) -> float:
        """Return the pan's speed over the last SPEED_WINDOW_S."""
        last = self.pans[-1]
        first = next((row for row in reversed(self.pans) if row[0] <= last[0] - SPEED_WINDOW_S), self.pans[0])
        return abs(last[1] - first[1]) / max(last[0] - first[0], 1e-3)

    def wait_for_rest(self) -> None:
        """Wait until the pan has been at rest for a moment."""
        time.sleep(MOTION_SEEN_S)
        self.until(lambda: self.speed_radps() < 0.01, "an arm at rest")

    def move_to_start(self) -> None:
        """Move the pan to START_RAD."""
        self.until(self._send_to_start, "the pan's service to move it", BODY_TIMEOUT_S)
        self.until(lambda: abs(self.pans[-1][1] - START_RAD) < 0.05, "the pan at its start", MOVE_TIMEOUT_S)
        self.wait_for_rest()

    def _send_to_start(self) -> bool:
        answer = self._ask(graph.arm_joint_angle(PAN), angle=START_RAD, rate=1.0, degrees=False)
        return bool(answer is not None and answer.status)

    def play(self) -> None:
        """Start the replay."""
        self.until(self._starts_to_play, "a replay that is accepted", BODY_TIMEOUT_S)

    def _starts_to_play(self) -> bool:
        answer = self._ask(graph.ARM_LIBRARY_PLAY, name=SEQUENCE, speed=1.0)
        # It also plays if the answer to an earlier request was lost.
        return bool(answer is not None and (answer.success or f"playing {SEQUENCE}" in answer.message))

    def _ask(self, row: graph.Service, **fields: Any) -> Any:
        """Call a service; return its response, or None: one of a process that was killed stays discovered for 20 s."""
        client = self._clients.setdefault(row.name, None) or self.node.client(row)
        self._clients[row.name] = client
        self.until(client.service_is_ready, f"server of {row.name}")
        future = client.call_async(interface(row.type).Request(**fields))
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
        while not future.done() and time.monotonic() < deadline_s:
            time.sleep(0.01)
        if not future.done():
            client.remove_pending_request(future)
            return None
        return future.result()

    def body_pid(self) -> int:
        """Return the PID of the process `body`."""
        return int(process_state(self.folder, BODY)["pid"])

    def rest_after_s(self, action: Callable[[], object]) -> float:
        """Act while the arm moves; return how long it moved on, also if it moves again within WATCH_S."""
        self.until(lambda: self.speed_radps() > MOVING_RADPS, "an arm that moves", MOVE_TIMEOUT_S)
        time.sleep(HOLD_S)
        began_s = time.monotonic()
        action()
        time.sleep(WATCH_S)
        end_rad = self.pans[-1][1]
        away = [time_s for time_s, pan in list(self.pans) if abs(pan - end_rad) > AT_REST_RAD]
        return max(0.0, away[-1] - began_s)


@contextmanager
def _client() -> Iterator[ArmClient]:
    with tempfile.TemporaryDirectory(prefix="lupin-pads-") as folder:
        pads = FakePads(Path(folder))
        client = ArmClient(live_runs()[-1].path, pads)
        try:
            yield client
        finally:
            client.close()
            pads.close()


def _print(figures: dict[str, Any]) -> int:
    print(json.dumps(figures), flush=True)
    return 0


# -- measuring ----------------------------------------------------------------------------------------------------------
def measure_jog(samples: int) -> int:
    """Jog the pan to and fro; print the times to the trajectories, from the pad's event and from the messages of the jog."""
    with _client() as client:
        request_realtime_scheduling()  # this process is the pad, too: its own scheduling delays must not count
        client.move_to_start()
        from_event_ms, lost = [], 0
        client.jogs.clear()
        client.trajectories.clear()
        for index in range(samples):
            code, count = (PAN_RIGHT, PAN_LEFT)[index % 2], len(client.trajectories)
            began_ns = time.time_ns()
            client.press(code, 1)
            time.sleep(HOLD_S)
            if len(client.trajectories) > count:
                from_event_ms.append((client.trajectories[count][1] - began_ns) / 1e6)
            else:
                lost += 1
            client.press(code, 0)
            time.sleep(REST_S)
        published = np.array([source_ns for source_ns, _ in client.trajectories])
        after = np.searchsorted(published, client.jogs)
        from_jog_ms = [float(published[i] - jog_ns) / 1e6 for i, jog_ns in zip(after, client.jogs) if i < len(published)]
    return _print(
        {
            "event_to_trajectory": {**percentiles(from_event_ms), "lost_share": lost / samples},
            "jog_to_trajectory": percentiles(from_jog_ms),
        }
    )


def measure_rest(signal_: str) -> int:
    """End the pad's process and `body` by this signal while the arm moves; print how long it moved on."""
    number = signal.Signals[f"SIG{signal_}"]
    time.sleep(RESTARTS_WITHIN_S)  # `body` is ended twice here; after four times within this it would be given up
    with _client() as client:
        rest_s = {
            "jog_without_pads": _rest_of_pads(client, number),
            "jog_without_body": _rest_of_body(client, number, _jog),
            "replay_without_body": _rest_of_body(client, number, ArmClient.play),
        }
        resumed = client.resumed
    return _print({"at_rest_s": rest_s, "resumed": resumed})


def _jog(client: ArmClient) -> None:
    client.press(PAN_RIGHT, 1)


def _rest_of_pads(client: ArmClient, number: signal.Signals) -> float:
    client.move_to_start()
    _jog(client)
    rest_s = client.rest_after_s(lambda: os.kill(client.process.pid, number))
    if number == signal.SIGSTOP:
        count = len(client.jogs)
        os.kill(client.process.pid, signal.SIGCONT)  # its pad is still held, but was not read for too long
        time.sleep(RESUME_S)
        client.resumed += len(client.jogs) - count
    client.restart_pads()
    return rest_s


def _rest_of_body(client: ArmClient, number: signal.Signals, move: Callable[[ArmClient], None]) -> float:
    client.move_to_start()
    move(client)
    pid = client.body_pid()
    rest_s = client.rest_after_s(lambda: os.kill(pid, number))
    client.until(lambda: is_replaced(client.folder, BODY, pid), "a new body", BODY_TIMEOUT_S)
    client.release()
    client.wait_for_rest()
    return rest_s


def measure_replay(playing: str) -> int:
    """Replay the sequence, and print when its waypoints are passed. The file `playing` is made once it moves."""
    with _client() as client:
        request_realtime_scheduling()
        client.move_to_start()
        client.paths.clear()
        client.pans.clear()
        client.play()
        began_s, path = client.until(
            lambda: next((row for row in client.paths if len(row[1]) == WAYPOINTS), None), f"a path of {WAYPOINTS} points"
        )
        client.until(lambda: time.monotonic() > began_s + path[0].t_s + 1.0, "its first waypoints")
        Path(playing).touch()
        client.until(lambda: time.monotonic() > began_s + path[-1].t_s + 1.0, "its end", path[-1].t_s + 5.0)
        pans = np.array([(time_s - began_s, pan) for time_s, pan in client.pans])
        late_ms = lateness_ms(pans[np.argmin(pans[:, 1]) :], np.array([(point.t_s, point.arm[0]) for point in path]))
    error_ms = np.abs(late_ms - np.median(late_ms))
    return _print({"lag_ms": float(np.median(late_ms)), "error": percentiles([float(value) for value in error_ms])})


def lateness_ms(pans: Any, waypoints: Any) -> Any:
    """Return how much later than commanded the pan passed each waypoint. Both are rows of seconds and angles that increase.

    Of the last waypoints, which it may miss by the servo's resolution, this is when it was at its farthest.
    """
    angles, first = np.unique(np.maximum.accumulate(pans[:, 1]), return_index=True)
    return 1e3 * (np.interp(waypoints[:, 1], angles, pans[first, 0]) - waypoints[:, 0])
