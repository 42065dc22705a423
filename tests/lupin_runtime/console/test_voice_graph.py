"""The voice agent on a real graph: bursts, control, the stop, and what the console accepts of a client."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.voice import envelope
from tests.support.console_browser import Browser, stop_texts
from tests.support.voice_client import VoiceClient, journal, serve_console

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

BURST = {"linear_x": 0.2, "duration_s": 2.0}


class Robot:
    """Records velocities, goals and stops; publishes the e-stop's state, transforms, odometry and battery."""

    def __init__(self, host: GraphHost) -> None:
        from lupin_runtime.ros import LupinNode

        self.node: LupinNode = LupinNode("robot")
        self.velocities: list[tuple[float, float, float]] = []
        self.goals: list[Any] = []
        self.stops: list[bool] = []
        self.node.subscription(graph.CMD_VEL_MANUAL, lambda m: self.velocities.append((m.linear.x, m.linear.y, m.angular.z)))
        self.node.subscription(graph.GOAL_POSE, self.goals.append)
        self.node.subscription(graph.CONSOLE_STOP, lambda m: self.stops.append(json.loads(m.data)["engaged"]))
        host.add(self.node)

    @property
    def is_driven(self) -> bool:
        return bool(self.velocities) and self.velocities[-1] != (0.0, 0.0, 0.0)

    def rests(self) -> bool:
        return self.velocities[-3:] == [(0.0, 0.0, 0.0)] * 3

    def localize(self, x: float = 1.0, y: float = 2.0, yaw: float = math.pi / 2) -> None:
        """Publish the transforms of a robot at this pose on the map, ten times a second."""
        from lupin_runtime.geometry import quaternion_from_yaw
        from lupin_runtime.ros import TransformBroadcaster
        from lupin_runtime.ros.tf import to_message
        from lupin_runtime.transforms import Transform

        broadcaster = TransformBroadcaster(self.node)

        def publish() -> None:
            now_ns = self.node.now_ns()
            broadcaster.send(
                to_message(graph.MAP_FRAME, graph.ODOM_FRAME, now_ns, Transform((x, y, 0.0), quaternion_from_yaw(yaw))),
                to_message(graph.ODOM_FRAME, graph.BASE_FRAME, now_ns, Transform()),
            )

        self.node.create_timer(0.1, publish)


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Console]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    node = serve_console(graph_host, tmp_path)
    yield node
    node.before_shutdown()


@pytest.fixture
def robot(graph_host: GraphHost, console: Console) -> Robot:
    made = Robot(graph_host)
    graph_host.until(lambda: made.stops and console.count_subscribers(graph.CMD_VEL_MANUAL.name), what="the connection")
    return made


def paired(console: Console, folder: Path, role: str = "operator") -> Browser:
    browser = Browser(console.port, proxied=True)
    browser.post("/_api/pair", code=json.loads((folder / "console.json").read_text())["codes"][role])
    return browser


@pytest.fixture
def browser(console: Console, tmp_path: Path) -> Browser:
    return paired(console, tmp_path)


@pytest.fixture
def voice(browser: Browser) -> Iterator[VoiceClient]:
    client = VoiceClient(browser)
    client.turn()
    yield client
    client.close()


# -- bursts -----------------------------------------------------------------------------------------------------------
def test_burst_is_limited_and_ends_with_zeros(graph_host: GraphHost, robot: Robot, voice: VoiceClient) -> None:
    done = voice.call("drive", linear_x=3.0, linear_y=4.0, angular_z=-9.0, duration_s=0.3)
    assert done == pytest.approx(
        {"ok": True, "action": "drive", "linear_x": 0.18, "linear_y": 0.24, "angular_z": -0.8, "duration_s": 0.3}
    )
    graph_host.until(lambda: robot.velocities[1:] and robot.rests(), what="the end of the burst")
    assert robot.velocities[0] == (0.0, 0.0, 0.0)
    moving = [velocity for velocity in robot.velocities if velocity != (0.0, 0.0, 0.0)]
    assert moving == [pytest.approx((0.18, 0.24, -0.8))] * len(moving) and 1 <= len(moving) <= 7
    voice.wait_for_state(lambda state: state["is_driving"])
    voice.wait_for_state(lambda state: not state["is_driving"] and state["turn"] == 1)


@pytest.mark.parametrize("end", ["stop", "cancel", "engage_estop", "close", "press", "lease", "setting"])
def test_burst_ends_at_once(
    graph_host: GraphHost, robot: Robot, voice: VoiceClient, browser: Browser, console: Console, tmp_path: Path, end: str
) -> None:
    voice.call("drive", **BURST)
    graph_host.until(lambda: robot.is_driven, what="motion")
    if end in ("stop", "engage_estop"):
        assert voice.call(end)["ok"]
    elif end == "cancel":
        voice.send(cancel=True)
    elif end == "close":
        voice.close()
    elif end == "press":
        browser.post("/_api/stop", engaged=True)
    elif end == "lease":
        other = paired(console, tmp_path)
        other.post("/_api/lease", **{"action": "take_over", "from": "phone-1"})
    else:
        browser.post("/_api/settings", settings={"voiceMaxLinearMps": 0.0})
        voice.turn()
        assert voice.call("drive", **BURST)["linear_x"] == 0.0
    graph_host.until(lambda: not robot.is_driven, what="zero")
    moving = sum(velocity != (0.0, 0.0, 0.0) for velocity in robot.velocities)
    assert moving < 2.0 / 0.05, "it did not last for its whole duration"


def test_burst_gives_way_to_the_operators_stick(
    graph_host: GraphHost, robot: Robot, voice: VoiceClient, browser: Browser
) -> None:
    stick = browser.socket()
    stick.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={"linear": {"x": 0.1}})
    graph_host.until(lambda: robot.is_driven, what="motion by hand")
    refused = voice.call("drive", **BURST)
    assert not refused["ok"] and refused["error"] == "the operator is driving by hand"
    stick.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={"linear": {"x": 0.0}})
    stick.close()


def test_speed_cap_and_polarity_of_the_session(
    graph_host: GraphHost, robot: Robot, voice: VoiceClient, browser: Browser
) -> None:
    assert voice.call("set_speed_cap", value=0.5) == pytest.approx(
        {"ok": True, "value": 0.5, "max_linear_mps": 0.15, "max_angular_rps": 0.4}
    )
    browser.post("/_api/settings", settings={"polarityInvertHmi": True})
    assert voice.call("drive", linear_x=1.0, duration_s=0.1)["linear_x"] == pytest.approx(0.15)
    graph_host.until(lambda: robot.velocities[1:] and robot.rests(), what="the end of the burst")
    assert min(robot.velocities) == pytest.approx((-0.15, 0.0, 0.0))


# -- the stop ---------------------------------------------------------------------------------------------------------
def test_engaged_stop_blocks_and_only_a_person_releases(
    graph_host: GraphHost, robot: Robot, voice: VoiceClient, browser: Browser
) -> None:
    assert voice.call("engage_estop") == {"ok": True, "action": "engage_estop", "reason": "voice-agent"}
    graph_host.until(lambda: robot.stops[-1], what="the stop")
    assert stop_texts(browser.get("/_api/session")) == ["voice agent of phone-1 stopped the robot"]
    voice.turn()
    for name, arguments in (("drive", BURST), ("nav_goto", {"x": 1, "y": 1}), ("arm_preset", {"name": "home"})):
        refused = voice.call(name, **arguments)
        assert refused["ok"] is False and refused["blocked"] is True
    assert voice.call("query_state", fields=["estop"])["estop"]["active"] is True
    assert not voice.call("release_estop")["ok"]
    assert voice.call("stop")["ok"]
    presses = [hold["press"] for hold in browser.get("/_api/session")["stop"]]
    browser.post("/_api/stop", engaged=False, presses=presses)
    graph_host.until(lambda: not robot.stops[-1], what="the release")
    assert voice.call("drive", linear_x=0.1, duration_s=0.1)["ok"]


def test_read_back_goal_is_outdated_by_a_stop(robot: Robot, voice: VoiceClient, browser: Browser) -> None:
    first = voice.call("nav_goto", x=1.0, y=1.0)
    browser.post("/_api/stop", engaged=True)
    browser.post("/_api/stop", engaged=False)
    voice.turn()
    refused = voice.call("nav_goto", x=1.0, y=1.0, confirmation=first["confirmation"])
    assert not refused["ok"] and "the robot was stopped or released" in refused["error"]
    assert robot.goals == []


# -- control ----------------------------------------------------------------------------------------------------------
def test_other_sessions_control_refuses_all_but_stops(
    graph_host: GraphHost, robot: Robot, voice: VoiceClient, console: Console, tmp_path: Path
) -> None:
    other = paired(console, tmp_path)
    other.post("/_api/lease", action="take")
    for name, arguments in (("drive", BURST), ("set_light", {"color": "red"}), ("save_named_location", {"name": "a"})):
        assert "phone-2 has had control" in voice.call(name, **arguments)["error"]
    assert voice.call("query_state", fields=["estop"])["ok"]
    assert voice.call("stop")["ok"] and voice.call("engage_estop")["ok"]
    assert voice.call("nav_cancel")["error"].startswith("Service") and voice.call("arm_stop")["error"].startswith("Service")
    graph_host.until(lambda: robot.stops[-1], what="the stop")
    assert not any(any(velocity) for velocity in robot.velocities)


def test_viewer_may_only_stop(console: Console, tmp_path: Path, graph_host: GraphHost, robot: Robot) -> None:
    client = VoiceClient(paired(console, tmp_path, "viewer"))
    client.turn()
    assert "is a viewer" in client.call("drive", **BURST)["error"]
    assert client.call("engage_estop")["ok"]
    graph_host.until(lambda: robot.stops[-1], what="the stop")
    client.close()


def test_unpaired_browser_gets_no_voice(console: Console) -> None:
    status, _ = Browser(console.port, proxied=True).request("GET", "/_api/voice")
    assert status == 401


# -- goals and locations ----------------------------------------------------------------------------------------------
def test_relative_goals_start_at_the_pose_on_the_map(graph_host: GraphHost, robot: Robot, voice: VoiceClient) -> None:
    assert voice.call("nav_forward", forward_m=1.0)["error"] == envelope.NO_POSE
    robot.localize()

    def is_known() -> bool:
        voice.turn()
        return "confirm" in voice.call("nav_forward", forward_m=1.0, lateral_m=0.5)

    graph_host.until(is_known, what="the pose")
    done = voice.confirm("nav_forward", forward_m=1.0, lateral_m=0.5)
    assert done["ok"] and done["from"] == {"x": 1.0, "y": 2.0, "yaw": 1.5708}
    assert done["goal"] == pytest.approx({"x": 0.5, "y": 3.0, "yaw": 1.5708}, abs=1e-3)
    graph_host.until(lambda: robot.goals, what="the goal")  # of which the next one takes the place
    done = voice.confirm("rotate", angle_deg=-90)
    assert done["to_yaw"] == pytest.approx(0.0, abs=1e-3)
    graph_host.until(lambda: len(robot.goals) == 2, what="the goals")
    assert robot.goals[0].header.frame_id == graph.MAP_FRAME
    assert (robot.goals[0].pose.position.x, robot.goals[1].pose.position.x) == pytest.approx((0.5, 1.0))


def test_lost_robot_has_no_pose(graph_host: GraphHost, robot: Robot, voice: VoiceClient) -> None:
    from geometry_msgs.msg import PoseWithCovarianceStamped

    from lupin_runtime.localization import LOST_YAW_VARIANCE

    robot.localize()
    publisher = robot.node.publisher(graph.AMCL_POSE)
    message = PoseWithCovarianceStamped()
    message.pose.covariance[35] = LOST_YAW_VARIANCE

    def is_refused() -> bool:
        publisher.publish(message)
        voice.turn()
        return voice.call("rotate", angle_deg=90).get("error") == envelope.NO_POSE

    def is_known() -> bool:
        voice.turn()
        return "confirm" in voice.call("rotate", angle_deg=90)

    graph_host.until(is_known, what="the pose")
    graph_host.until(is_refused, what="the lost robot")


def test_locations_are_saved_listed_and_gone_to(
    graph_host: GraphHost, robot: Robot, voice: VoiceClient, browser: Browser
) -> None:
    robot.localize()

    def is_saved() -> bool:
        voice.turn()
        return bool(voice.call("save_named_location", name="row 3")["ok"])

    graph_host.until(is_saved, what="the pose")
    assert browser.get("/_api/locations")["row 3"] == pytest.approx({"x": 1.0, "y": 2.0, "yaw": math.pi / 2})
    voice.turn()
    names = [each["name"] for each in voice.call("list_named_locations")["locations"]]
    assert names == [{"untrusted": "home"}, {"untrusted": "row 3"}]
    assert voice.call("nav_goto_named", name="the moon")["locations"] == names
    assert voice.confirm("nav_goto_named", name="Row 3")["ok"]
    graph_host.until(lambda: robot.goals, what="the goal")  # of which the next one takes the place
    assert voice.confirm("nav_goto", x=-1, y=0.5, yaw=3.1416)["ok"]
    graph_host.until(lambda: len(robot.goals) == 2, what="the goals")
    assert [goal.pose.position.x for goal in robot.goals] == [1.0, -1.0]


def test_state_is_read_from_the_robot(graph_host: GraphHost, robot: Robot, voice: VoiceClient) -> None:
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import BatteryState

    assert voice.call("query_state") == {
        "ok": True, "pose": None, "battery": None, "estop": {"active": False, "reason": None},
    }  # fmt: skip
    odometry, battery = robot.node.publisher(graph.ODOM), robot.node.publisher(graph.BATTERY)
    moved = Odometry()
    moved.pose.pose.position.x, moved.pose.pose.orientation.w = 1.5, 1.0

    def state() -> dict[str, Any] | None:
        odometry.publish(moved)
        battery.publish(BatteryState(voltage=12.25, percentage=0.75))
        voice.turn()
        found = voice.call("query_state", fields=["pose", "battery"])
        return found if found["pose"] and found["battery"] else None

    found = graph_host.until(state, what="the state")
    assert found["pose"] == {"x": 1.5, "y": 0.0, "yaw": 0.0}
    assert found["battery"] == {"voltage": 12.25, "percentage": 0.75}


# -- the protocol -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "7", '{"turn": 1, "call": 2}', '{"turn": {}}', '{"turn": {"id": "a", "by": "model"}}', '{"release": true}',
     '{"turn": {"id": "a", "by": "text", "ended": 1}}', '{"call": {"name": "stop"}}', '{"call": {"id": 7, "name": "stop"}}',
     '{"call": {"id": "\\ud800", "name": "stop"}}', "[" * 5000],
)  # fmt: skip
def test_malformed_message_is_answered_and_survived(voice: VoiceClient, text: str) -> None:
    voice.client.socket.send(text)
    assert voice.client.wait(lambda message: "error" in message)["error"]
    assert voice.call("query_state", fields=["estop"])["ok"]


def test_agent_in_a_loop_is_cut_off_and_told_to_the_page(voice: VoiceClient, graph_host: GraphHost, robot: Robot) -> None:
    for _ in range(6):
        voice.call("drive", linear_x=0.1, duration_s=2.0)
    assert "drive with the same arguments" in voice.client.wait(lambda message: "cut_off" in message)["cut_off"]
    graph_host.until(lambda: not robot.is_driven, what="the end of the burst")
    assert voice.wait_for_state(lambda state: state["cut_off"])
    assert voice.call("stop")["ok"]
    voice.turn()
    assert voice.call("drive", linear_x=0.1, duration_s=0.1)["ok"]


def test_cut_off_agent_is_not_free_once_it_connects_again(voice: VoiceClient, browser: Browser) -> None:
    for number in range(21):
        voice.call("rotate", angle_deg=number)
    again = VoiceClient(browser)
    assert "cut off" in again.call("query_state", fields=["estop"])["error"]
    again.close()


def test_every_call_is_in_the_journal(voice: VoiceClient, tmp_path: Path) -> None:
    voice.call("query_state", fields=["estop"])
    voice.call("nav_goto", x=5000, y=0)
    voice.call("arm_dance", style="tango")
    voice.call("rotate", angle_deg=1)
    voice.call("stop")
    rows = {row["what"].split(" ", 2)[1]: row for row in journal(tmp_path) if row["what"].startswith("voice ")}
    assert rows.keys() >= {"query_state", "nav_goto", "arm_dance", "rotate", "stop"}
    assert "not 5000" in rows["nav_goto"]["refused"] and "there is no tool" in rows["arm_dance"]["refused"]
    assert rows["rotate"]["session"] == "phone-1" and "refused" not in rows["stop"]


def test_second_tab_takes_the_voice_session_over(voice: VoiceClient, browser: Browser) -> None:
    second = VoiceClient(browser)
    second.turn("text")
    assert second.call("query_state", fields=["estop"])["ok"]
    with pytest.raises(Exception, match="another tab"):
        voice.call("query_state", fields=["estop"])
    second.close()


def test_console_without_voice_loads_none_of_its_modules(console: Console) -> None:
    assert console._server._origin._voice is None
