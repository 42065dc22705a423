"""The voice agent's tools for the arm, the gripper and the lights, against this repository's own nodes on a real graph."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.arm.calibration import HOME_COUNTS
from lupin_runtime.arm.presets import PRESETS
from lupin_runtime.lights import COLORS_BY_NAME
from lupin_runtime.voice import envelope
from tests.support.arm_vendor import Console as ServiceClient
from tests.support.arm_vendor import Vendor, arm_nodes, record
from tests.support.console_browser import Browser
from tests.support.servo_vendor import Servos
from tests.support.voice_client import VoiceClient, serve_console

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    node = serve_console(graph_host, tmp_path)
    yield node
    node.before_shutdown()


@pytest.fixture
def voice(console: Console) -> Iterator[VoiceClient]:
    browser = Browser(console.port)
    browser.get("/")
    client = VoiceClient(browser)
    client.turn()
    yield client
    client.close()


@pytest.fixture
def vendor(graph_host: GraphHost) -> Iterator[Vendor]:
    made = Vendor(graph_host)
    yield made
    made.close()


@pytest.fixture
def arm(graph_host: GraphHost, tmp_path: Path, vendor: Vendor) -> list[Any]:
    """The arm's nodes: presets, gripper, library."""
    return list(arm_nodes(graph_host, tmp_path, pinned_by=vendor))


def call_until_served(host: GraphHost, voice: VoiceClient, call: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Call, each time in a new turn, until the console has discovered the tool's service."""

    def result() -> dict[str, Any] | None:
        voice.turn()
        found = call()
        return None if "does not exist" in str(found.get("error")) else found

    return dict(host.until(result, what="the service"))


@pytest.mark.usefixtures("arm")
def test_presets_and_stored_poses_move_the_arm(graph_host: GraphHost, voice: VoiceClient, vendor: Vendor) -> None:
    done = call_until_served(graph_host, voice, lambda: voice.confirm("arm_preset", name="Home"))
    assert done == {"ok": True, "name": "home", "message": {"untrusted": "moving to home, 3 s"}}
    graph_host.until(lambda: vendor.last == PRESETS["home"], what="the arm at home")
    saved = call_until_served(graph_host, voice, lambda: voice.call("arm_save_pose", name="Wave"))
    assert saved["message"] == {"untrusted": "pose wave saved"}
    assert voice.call("arm_list_library") == {"ok": True, "poses": [{"untrusted": "wave"}], "sequences": []}
    assert voice.confirm("arm_goto_pose", name="tuck")["ok"]
    graph_host.until(lambda: vendor.last == PRESETS["tuck"], what="the arm tucked")
    assert call_until_served(graph_host, voice, lambda: voice.confirm("arm_goto_pose", name="wave"))["ok"]
    graph_host.until(lambda: vendor.last == pytest.approx(tuple(vendor.at), abs=1e-3), what="the stored pose")
    refused = voice.call("arm_goto_pose", name="unknown")
    assert refused == {"ok": False, "error": "there is no pose of this name", "poses": [{"untrusted": "wave"}]}


@pytest.mark.usefixtures("arm")
def test_arm_does_not_move_before_the_operator_confirms(graph_host: GraphHost, voice: VoiceClient, vendor: Vendor) -> None:
    sent = len(vendor.trajectories)
    first = voice.call("arm_preset", name="tuck")
    assert first["confirm"] == "move the arm to the built-in pose tuck"
    again = voice.call("arm_preset", name="tuck", confirmation=first["confirmation"])
    assert again["error"] == envelope.NOT_CONFIRMED
    voice.turn()
    assert not voice.call("arm_preset", name="pick", confirmation=first["confirmation"])["ok"]
    assert call_until_served(graph_host, voice, lambda: voice.confirm("arm_preset", name="home"))["ok"]
    graph_host.until(lambda: len(vendor.trajectories) > sent, what="the confirmed motion")
    assert all(tuple(m.points[-1].positions) != PRESETS["tuck"] for m in vendor.trajectories[sent:])


def test_motion_is_refused_by_the_arm_under_its_own_estop(graph_host: GraphHost, voice: VoiceClient, arm: list[Any]) -> None:
    arm[0].motion.set_estop(True)
    refused = call_until_served(graph_host, voice, lambda: voice.confirm("arm_preset", name="home"))
    assert refused["ok"] is False and "e-stop" in refused["message"]["untrusted"]


@pytest.mark.usefixtures("arm")
def test_gripper_is_commanded_on_its_inverted_scale(graph_host: GraphHost, voice: VoiceClient, vendor: Vendor) -> None:
    done = call_until_served(graph_host, voice, lambda: voice.confirm("gripper", action="open"))
    assert (done["direction"], done["percent"], done["angle_deg"]) == ("open", 100.0, -30.0)
    graph_host.until(lambda: vendor.gripper_goals and vendor.gripper_goals[-1][0] == pytest.approx(-0.20), what="open")
    assert voice.confirm("gripper", action="close")["angle_deg"] == 30.0
    graph_host.until(lambda: vendor.gripper_goals[-1][0] == pytest.approx(0.25), what="closed")
    assert voice.confirm("gripper", action="set", percent=50)["angle_deg"] == 0.0


@pytest.mark.usefixtures("arm")
def test_recording_is_saved_in_a_later_turn_and_replayed(graph_host: GraphHost, voice: VoiceClient, vendor: Vendor) -> None:
    started = call_until_served(graph_host, voice, lambda: voice.confirm("arm_record", action="start", name="hello"))
    assert started["ok"] and started["message"] == {"untrusted": "recording, teleop"}
    assert "same turn" in voice.call("arm_record", action="save")["error"]
    vendor.at = [0.5, 0.2, 0.3, -0.4]

    def saved() -> dict[str, Any] | None:
        voice.turn()
        found = voice.call("arm_record", action="save")
        return found if found["ok"] else None

    done = graph_host.until(saved, what="the recording")
    assert done["n_waypoints"] >= 1 and done["duration_s"] >= 0.0
    assert voice.call("arm_list_library")["sequences"] == [{"untrusted": "hello"}]
    played = voice.confirm("arm_run_sequence", name="hello", speed=0.25)
    assert played["ok"] and played["speed"] == 0.25


def test_replay_is_stopped_by_voice(graph_host: GraphHost, voice: VoiceClient, vendor: Vendor, arm: list[Any]) -> None:
    service_client = ServiceClient(graph_host)
    graph_host.until(lambda: service_client.states, what="the library's state")
    record(graph_host, vendor, service_client, "hello", "teleop")
    assert call_until_served(graph_host, voice, lambda: voice.confirm("arm_run_sequence", name="hello", speed=0.25))["ok"]
    stopped = call_until_served(graph_host, voice, lambda: voice.call("arm_stop"))
    assert stopped["ok"] and stopped["message"]["untrusted"] in ("playing ended", "nothing was running")
    graph_host.until(lambda: service_client.states[-1]["playing"] is False, what="the end of the replay")
    assert arm


@pytest.mark.usefixtures("arm")
def test_kinesthetic_recording_makes_the_arm_limp_once_confirmed(
    graph_host: GraphHost, voice: VoiceClient, vendor: Vendor
) -> None:
    first = voice.call("arm_record", action="start", mode="kinesthetic", name="led")
    assert first["confirm"] == "start a kinesthetic recording of the arm"
    assert ("torque", False) not in vendor.calls
    started = call_until_served(
        graph_host, voice, lambda: voice.confirm("arm_record", action="start", mode="kinesthetic", name="led")
    )
    assert started["ok"] and ("torque", False) in vendor.calls
    voice.turn()
    assert voice.call("arm_record", action="cancel")["ok"]
    assert vendor.calls[-2:] == [("torque", True), ("gate", True)]


# -- calibration ------------------------------------------------------------------------------------------------------
@pytest.fixture
def servos(graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch) -> Servos:
    """The servo bus, and the calibration's server with short waits."""
    from lupin_runtime.arm import calibrate_server
    from lupin_runtime.arm.node import ArmCalibrateServer, ArmPresetServer, GripperActionBridge

    monkeypatch.setattr(calibrate_server, "SETTLE_S", 0.1)
    monkeypatch.setattr(calibrate_server, "SAMPLE_S", 0.3)
    made = Servos(graph_host)
    for node in (ArmPresetServer(), GripperActionBridge(), ArmCalibrateServer()):
        graph_host.add(node)
        node.motion.set_estop(False)
    graph_host.until(lambda: ("pin",) in made.calls, what="the servos to be pinned")
    made.calls.clear()
    return made


def test_calibration_waits_for_the_operator_before_it_commits(
    graph_host: GraphHost, voice: VoiceClient, servos: Servos
) -> None:
    assert call_until_served(graph_host, voice, lambda: voice.call("calibrate_arm", action="status"))["state"] == "IDLE"
    started = voice.confirm("calibrate_arm", action="start")
    assert started["ok"] and started["state"] == "AWAITING_POSE", started
    assert "same turn" in voice.call("calibrate_arm", action="commit")["error"]
    voice.turn("button")
    assert voice.call("calibrate_arm", action="commit")["error"] == envelope.NO_UTTERANCE
    assert set(servos.offsets.values()) == {0}, "nothing is written before the operator has spoken"
    voice.turn("speech")
    done = voice.confirm("calibrate_arm", action="commit")
    assert done["ok"] and done["state"] == "IDLE" and done["joint_names"] == list(HOME_COUNTS)
    assert set(servos.offsets.values()) == {1000} and done["offsets_applied"] == [1000] * 4


def test_calibration_is_cancelled_at_once(graph_host: GraphHost, voice: VoiceClient, servos: Servos) -> None:
    assert call_until_served(graph_host, voice, lambda: voice.confirm("calibrate_arm", action="start"))["ok"]
    cancelled = voice.call("calibrate_arm", action="cancel")
    assert cancelled["ok"] and cancelled["state"] == "IDLE"
    assert set(servos.offsets.values()) == {40}


# -- lights -----------------------------------------------------------------------------------------------------------
def test_strip_shows_a_color_and_returns_to_the_robots_state(graph_host: GraphHost, voice: VoiceClient) -> None:
    from lupin_msgs.msg import MissionState

    from lupin_runtime.lights.node import LightStripBridge
    from lupin_runtime.ros import LupinNode

    colors: list[tuple[int, ...]] = []

    def set_color(request: Any, response: Any) -> Any:
        colors.append((request.color.r, request.color.g, request.color.b))
        response.status = True
        return response

    strip = LupinNode("strip")
    strip.service(graph.VENDOR_LEDS, set_color)
    graph_host.add(strip)
    graph_host.add(LightStripBridge())
    graph_host.until(lambda: colors, what="the first color")

    def is_set() -> dict[str, Any] | None:
        voice.turn()
        found = voice.call("set_light", color="Purple")
        return found if found["ok"] else None

    assert graph_host.until(is_set, what="the strip") == {
        "ok": True, "action": "set", "color": "purple", "rgb": [180, 0, 255],
    }  # fmt: skip
    graph_host.until(lambda: colors[-1] == tuple(COLORS_BY_NAME["PURPLE"]), what="purple")
    done = voice.call("set_light", mode="auto")
    assert done["ok"] and done["message"]["untrusted"].startswith("the strip follows the robot again")
    graph_host.until(lambda: colors[-1] == tuple(COLORS_BY_NAME["BLUE"]), what="blue")
    # A fault is red, whatever color was set, and the result says so.
    missions = strip.publisher(graph.MISSION_STATE)
    missions.publish(MissionState(lifecycle_state="FAULT"))
    graph_host.until(lambda: colors[-1] == tuple(COLORS_BY_NAME["RED"]), what="red")

    def is_hidden() -> dict[str, Any] | None:
        voice.turn()
        found = voice.call("set_light", color="teal")
        return found if "shown" in found else None

    hidden = graph_host.until(is_hidden, what="the rule of the light at the console")
    assert hidden["ok"] and hidden["shown"] is False and "e-stop or fault" in hidden["message"]
    assert colors[-1] == tuple(COLORS_BY_NAME["RED"])
