"""Plays recordings back onto the graph: `python -m lupin_runtime.record.player FILE… [--rate R] [--loop] …`.

Messages are published as the recorded bytes, each topic with its recorded QoS, and `/clock` follows the recording's time.
Progress is printed to standard output, one JSON object per line.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from lupin_runtime import graph
from lupin_runtime.ending import exit_with
from lupin_runtime.exit_codes import FAILURE, INTERRUPTED, SUCCESS, USAGE_ERROR
from lupin_runtime.graph import Qos, Topic
from lupin_runtime.record.reader import MESSAGE_LIMIT_BYTES, ChannelInfo, NotARecording, RawMessage, Recording
from lupin_runtime.yaml_text import load_yaml

CLOCK_PERIOD_S = 0.02
PROGRESS_PERIOD_S = 0.25
SETTLE_S = 2.0
# The queue length of a reliable publisher for slow subscriptions.
_DEPTH = 100


def topic_of(channel: ChannelInfo) -> Topic:
    """The row of `graph.py` for a recorded topic; an unknown topic gets its recorded QoS, or the default."""
    known = {topic.name: topic for topic in graph.topics()}
    if channel.topic in known and known[channel.topic].type == channel.type:
        return known[channel.topic]
    return Topic(channel.topic, channel.type, _recorded_qos(channel.qos))


def _recorded_qos(text: str) -> Qos:
    """The first profile of a rosbag2 `offered_qos_profiles` text; Humble wrote its policies as numbers."""
    try:
        profiles = load_yaml(text)
        first = profiles[0]
        return Qos(
            reliable=first["reliability"] in ("reliable", 1),
            latched=first["durability"] in ("transient_local", 1),
            depth=max(1, min(_DEPTH, int(first["depth"]))),
        )
    except (yaml.YAMLError, LookupError, TypeError, ValueError):
        return graph.REL10


@dataclass(frozen=True)
class Due:
    """A message and the time of its publication, in seconds after the start."""

    at_s: float
    message: RawMessage


def schedule(messages: Iterable[RawMessage], start_ns: int, rate: float) -> Iterator[Due]:
    """When each message is due at `rate` times the recorded speed. The times never decrease."""
    latest_s = 0.0
    for message in messages:
        latest_s = max(latest_s, (message.log_ns - start_ns) / 1e9 / rate)
        yield Due(latest_s, message)


class GraphPlayer:
    """Publishes recordings. `report` is called with the progress about four times a second."""

    def __init__(self, node: Any, report: Callable[[dict[str, Any]], None], stop: threading.Event) -> None:
        self._node = node
        self._report = report
        self._stop = stop
        self._publishers: dict[str, Any] = {}
        self._clock = node.publisher(graph.CLOCK)
        self._clock_due_s = 0.0
        self._reported_s = -PROGRESS_PERIOD_S
        self._types: dict[str, Any] = {}
        self.published = 0
        self.unreadable: Counter[str] = Counter()  # messages that were not published, by topic

    def advertise(self, channels: Iterable[ChannelInfo], wanted: set[str] | None) -> list[str]:
        """Create the publishers; returns a message for each topic that cannot be played."""
        from lupin_runtime.ros.interfaces import interface

        problems = []
        for channel in channels:
            if (wanted is not None and channel.topic not in wanted) or channel.topic == graph.CLOCK.name:
                continue
            try:
                self._publishers[channel.topic] = self._node.publisher(topic_of(channel))
                self._types[channel.topic] = interface(channel.type)
            except (ImportError, AttributeError, ValueError) as error:
                problems.append(f"{channel.topic} is not played: {channel.type or 'no type'}: {error}")
        return problems

    def wait_for_subscribers(self, timeout_s: float) -> None:
        """Return when every played topic has a subscriber, or after `timeout_s`."""
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s and not self._stop.wait(0.05):
            if all(publisher.get_subscription_count() for publisher in self._publishers.values()):
                return

    def settle(self, timeout_s: float) -> None:
        """Return when every reliable message is acknowledged, or after `timeout_s`."""
        from rclpy.duration import Duration

        deadline_s = time.monotonic() + timeout_s
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline_s - time.monotonic())))

    def play(self, messages: Iterable[RawMessage], start_ns: int, end_ns: int, rate: float) -> bool:
        """Publish the messages once; returns False where it was stopped."""
        started_s = time.monotonic()
        self._clock_due_s = 0.0
        self._reported_s = -PROGRESS_PERIOD_S
        for due in schedule(messages, start_ns, rate):
            while (left_s := due.at_s - (time.monotonic() - started_s)) > 0.0:
                self._tick(time.monotonic() - started_s, start_ns, end_ns, rate)
                if self._stop.wait(min(left_s, CLOCK_PERIOD_S)):
                    return False
            if self._stop.is_set():
                return False
            self._tick(due.at_s, start_ns, end_ns, rate)
            publisher = self._publishers.get(due.message.topic)
            if publisher is not None and self._is_readable(due.message):
                publisher.publish(due.message.data)
                self.published += 1
        self._progress((end_ns - start_ns) / 1e9, start_ns, end_ns)
        return True

    def _is_readable(self, message: RawMessage) -> bool:
        """Return whether a message fits its topic's type: one that does not would stop the programs that subscribe."""
        from rclpy.serialization import deserialize_message

        try:
            if len(message.data) <= MESSAGE_LIMIT_BYTES:
                deserialize_message(message.data, self._types[message.topic])
        except RuntimeError:  # rmw's error
            self.unreadable[message.topic] += 1
            return False
        return True

    def _tick(self, at_s: float, start_ns: int, end_ns: int, rate: float) -> None:
        from rosgraph_msgs.msg import Clock

        from lupin_runtime.ros import stamp_from_ns

        recorded_s = at_s * rate
        if at_s >= self._clock_due_s:
            self._clock_due_s = at_s + CLOCK_PERIOD_S
            self._clock.publish(Clock(clock=stamp_from_ns(start_ns + int(recorded_s * 1e9))))
        if at_s >= self._reported_s + PROGRESS_PERIOD_S:
            self._reported_s = at_s
            self._progress(recorded_s, start_ns, end_ns)

    def _progress(self, recorded_s: float, start_ns: int, end_ns: int) -> None:
        duration_s = (end_ns - start_ns) / 1e9
        self._report({"at_s": round(min(recorded_s, duration_s), 3), "of_s": round(duration_s, 3), "published": self.published})


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m lupin_runtime.record.player", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="MCAP recordings, oldest first")
    parser.add_argument("--rate", type=float, default=1.0, help="playback speed relative to the recording")
    parser.add_argument("--loop", action="store_true", help="start again at the end")
    parser.add_argument("--topics", default="", help="comma-separated names; default: all")
    parser.add_argument("--end-with-parent", action="store_true", help="stop when standard input ends")
    parser.add_argument("--wait-s", type=float, default=0.0, help="wait this long for subscribers to every topic")
    return parser


def main() -> int:
    """Play until the end, SIGINT, SIGTERM or SIGHUP. Exit status: 0 played, 1 unreadable file, 2 usage, 130 stopped."""
    arguments = _arguments().parse_args()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    if arguments.end_with_parent:
        from lupin_runtime.ros.supervision import end_with_parent

        end_with_parent()
    if not 0.0 < arguments.rate < float("inf"):
        print(f"--rate {arguments.rate} is not a valid speed; expected a positive number", file=sys.stderr)
        return USAGE_ERROR
    try:
        recordings = [Recording(path) for path in arguments.files]
        summaries = [recording.summary() for recording in recordings]
    except NotARecording as error:
        print(error, file=sys.stderr)
        return FAILURE
    recorded = {topic.channel.topic: topic.channel for summary in summaries for topic in summary.topics}
    wanted = {name.strip() for name in arguments.topics.split(",") if name.strip()} or None
    if wanted is not None and (missing := wanted - recorded.keys()):
        print(f"not recorded: {', '.join(sorted(missing))}; list what is with: lupin replay --info", file=sys.stderr)
        return USAGE_ERROR
    non_empty = [summary for summary in summaries if summary.messages]
    if not non_empty:
        print(f"{arguments.files[0]} holds no messages", file=sys.stderr)
        return FAILURE
    return _play(
        recordings,
        recorded.values(),
        wanted,
        (min(summary.start_ns for summary in non_empty), max(summary.end_ns for summary in non_empty)),
        arguments,
        stop,
    )


def _play(
    recordings: list[Recording],
    channels: Iterable[ChannelInfo],
    wanted: set[str] | None,
    span_ns: tuple[int, int],
    arguments: argparse.Namespace,
    stop: threading.Event,
) -> int:
    import rclpy

    from lupin_runtime.ros.leaving import leave_graph
    from lupin_runtime.ros.node import ROS_ARGUMENTS, LupinNode

    rclpy.init(args=ROS_ARGUMENTS, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = LupinNode("lupin_replay", enable_rosout=False)
    try:
        player = GraphPlayer(node, _print_line, stop)
        for problem in player.advertise(channels, wanted):
            print(problem, file=sys.stderr)
        player.wait_for_subscribers(arguments.wait_s)
        whole = True
        while whole and not stop.is_set():
            messages = (message for recording in recordings for message in recording.raw(wanted))
            whole = player.play(messages, *span_ns, arguments.rate)
            if not arguments.loop:
                break
        player.settle(SETTLE_S)
        for topic, count in sorted(player.unreadable.items()):
            print(f"{topic}: {count} messages do not fit their type and were not played", file=sys.stderr)
        return SUCCESS if whole and not stop.is_set() else INTERRUPTED
    finally:
        leave_graph(node)


def _print_line(progress: dict[str, Any]) -> None:
    print(json.dumps(progress), flush=True)


if __name__ == "__main__":
    exit_with(main())
