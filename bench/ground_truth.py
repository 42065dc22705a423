"""Says what an operator's program receives from the robot: which topics deliver, and whether services return.

It joins the graph with the configuration of the shell that starts it, as any program of the operator's does. It shares no code
with the doctor, which the bench judges by it, and it commands nothing. It prints one JSON object: `topics` by name (samples,
rate in Hz, age in s by the stamp, None without one), `services` by name (seconds until the answer, None without one), `drive`
(whether the drive bus hears commands of this machine), and `broken`, one line for each that an operator could not work with.
"""

from __future__ import annotations

import importlib
import json
import struct
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from bench.runner import read_options

MIN_RATE = 0.4  # of the nominal rate, below which a topic is of no use
MAX_AGE_S = 1.0  # transforms of this age are refused by navigation and mapping
WINDOW_S = 2.5  # over which rates are measured
LIMIT_S = 12.0  # discovery on a busy machine takes seconds
EVALUATION_PERIOD_S = 0.2
REPEAT_CALL_S = 2.0


@dataclass(frozen=True)
class Required:
    """A topic without which the robot is of no use: its type, its nominal rate, and whether it begins with a header."""

    type: str
    rate_hz: float
    stamped: bool = False


TOPICS = {
    "/scan": Required("sensor_msgs/LaserScan", 10.0, stamped=True),
    "/mirte_base_controller/odom": Required("nav_msgs/Odometry", 50.0, stamped=True),
    "/joint_states": Required("sensor_msgs/JointState", 50.0, stamped=True),
    "/io/imu/movement/data": Required("sensor_msgs/Imu", 50.0, stamped=True),
    "/io/power/power_watcher": Required("sensor_msgs/BatteryState", 1.0),
    "/io/intensity/emergency_button/digital": Required("mirte_msgs/IntensityDigital", 10.0),
    "/tf": Required("tf2_msgs/TFMessage", 50.0),
    "/e_stop_state": Required("std_msgs/Bool", 5.0),
    "/lupin/drive/status": Required("std_msgs/String", 1.0),
}
# One of the vendor's and one of Lupin's; both only read.
SERVICES = {
    "/controller_manager/list_controllers": "controller_manager_msgs/ListControllers",
    "/lupin/arm/library/list": "lupin_msgs/GetArmLibrary",
}
DRIVE_INPUT = "/cmd_vel_manual"


@dataclass
class Heard:
    """What was received of one topic lately: the times of arrival, and the ages of the samples by their stamps."""

    arrivals_s: deque[float] = field(default_factory=lambda: deque(maxlen=400))
    ages_s: deque[float] = field(default_factory=lambda: deque(maxlen=20))

    def rate_hz(self, now_s: float) -> float:
        """Samples per second within the last WINDOW_S."""
        return sum(now_s - arrival <= WINDOW_S for arrival in self.arrivals_s) / WINDOW_S

    def age_s(self) -> float | None:
        """The median age of the latest samples; None without a stamp."""
        latest = sorted(self.ages_s)
        return latest[len(latest) // 2] if latest else None


def stamp_s(sample: bytes) -> float:
    """Return the stamp of a serialized message that begins with a header: CDR, little endian, behind four bytes."""
    seconds, nanoseconds = struct.unpack_from("<iI", sample, 4)
    return float(seconds + nanoseconds / 1e9)


def is_usable(required: Required, heard: Heard, now_s: float) -> bool:
    """Whether an operator could work with what was received of a topic."""
    age_s = heard.age_s()
    enough = heard.rate_hz(now_s) >= min(required.rate_hz * MIN_RATE, required.rate_hz - 1.0 / WINDOW_S)
    return bool(heard.arrivals_s) and enough and (age_s is None or abs(age_s) <= MAX_AGE_S)


def broken_lines(
    topics: Mapping[str, Heard], services: Mapping[str, float | None], drive: bool, now_s: float
) -> tuple[str, ...]:
    """Return one line for each topic, service or path that an operator could not work with."""
    lines = []
    for name, heard in topics.items():
        if not is_usable(TOPICS[name], heard, now_s):
            age_s = heard.age_s()
            age = "" if age_s is None or abs(age_s) <= MAX_AGE_S else f", {age_s:+.1f} s old"
            lines.append(f"{name}: {len(heard.arrivals_s)} samples, {heard.rate_hz(now_s):.1f} Hz{age}")
    lines += [f"{name}: no answer" for name, answered_s in services.items() if answered_s is None]
    return tuple(lines) if drive else (*lines, f"{DRIVE_INPUT}: the drive bus does not listen")


def observe(limit_s: Annotated[float, "observe for at most this many seconds"] = LIMIT_S) -> dict[str, Any]:
    """Join the graph, and observe until everything works or the limit is over."""
    import rclpy
    from rclpy.qos import QoSProfile, QoSReliabilityPolicy
    from rclpy.signals import SignalHandlerOptions

    began_s = time.monotonic()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("bench_ground_truth", start_parameter_services=False, enable_rosout=False)
    topics = {name: Heard() for name in TOPICS}
    for name, required in TOPICS.items():
        node.create_subscription(
            _interface(required.type, "msg"),
            name,
            _recorder(topics[name], required.stamped),
            QoSProfile(depth=50, reliability=QoSReliabilityPolicy.BEST_EFFORT),
            raw=True,
        )
    publisher = node.create_publisher(_interface("geometry_msgs/Twist", "msg"), DRIVE_INPUT, 1)
    clients = {name: node.create_client(_interface(type_name, "srv"), name) for name, type_name in SERVICES.items()}
    calls: dict[str, Any] = {}
    called_s: dict[str, float] = {}
    services: dict[str, float | None] = dict.fromkeys(SERVICES)
    evaluated_s = began_s
    while True:
        rclpy.spin_once(node, timeout_sec=0.05)
        now_s = time.monotonic()
        if now_s - evaluated_s < EVALUATION_PERIOD_S:
            continue
        evaluated_s = now_s
        for name, client in clients.items():
            if name in calls and services[name] is None and calls[name].done():
                services[name] = round(now_s - called_s[name], 3)
            # A server may answer before it knows the reader of its answers, which is then lost: programs ask again.
            is_due = name not in calls or (services[name] is None and now_s - called_s[name] > REPEAT_CALL_S)
            if is_due and client.service_is_ready():
                calls[name], called_s[name] = client.call_async(client.srv_type.Request()), now_s
        drive = publisher.get_subscription_count() > 0
        broken = broken_lines(topics, services, drive, now_s)
        if (not broken and now_s - began_s > WINDOW_S) or now_s - began_s > limit_s:
            break
    node.destroy_node()
    rclpy.shutdown()  # removes its shared memory, which the doctor would find
    return {
        "topics": {
            name: {"samples": len(heard.arrivals_s), "rate_hz": round(heard.rate_hz(now_s), 1), "age_s": heard.age_s()}
            for name, heard in topics.items()
        },
        "services": services,
        "drive": drive,
        "broken": broken,
        "took_s": round(now_s - began_s, 2),
    }


def _recorder(heard: Heard, stamped: bool) -> Any:
    def record(sample: bytes) -> None:
        heard.arrivals_s.append(time.monotonic())
        if stamped:
            heard.ages_s.append(round(time.time() - stamp_s(sample), 3))

    return record


def _interface(name: str, kind: str) -> Any:
    package, _, type_name = name.partition("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), type_name)


def main(arguments: Sequence[str] | None = None) -> None:
    """Observe, and print the JSON object."""
    _, options = read_options(observe, arguments, "bench.ground_truth", __doc__ or "")
    print(json.dumps(observe(**options)), flush=True)


if __name__ == "__main__":
    main()
