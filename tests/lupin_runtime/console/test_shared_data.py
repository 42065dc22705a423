"""What all browsers share in the API: named locations, settings, maps and the arm's library."""

from __future__ import annotations

import json
import shlex
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.console import locations, settings
from lupin_runtime.console.shared_file import change_object
from tests.support.console_browser import Browser

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

HOME = {"x": 0.0, "y": 0.0, "yaw": 0.0}
POSE = {"x": 1.5, "y": -2.0, "yaw": 0.5}


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder with the data that the browsers share."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "lupin" / "console"


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path, state: Path) -> Iterator[Console]:
    from lupin_runtime.console.node import Console

    files = {"folder": str(tmp_path), "sessions_file": str(state / "sessions.json")}
    node: Console = graph_host.add(Console({"port": 0, "rosbridge_port": 0, **files}))
    yield node
    node.before_shutdown()


@pytest.fixture
def browser(console: Console) -> Browser:
    """The operator's browser on this computer."""
    made = Browser(console.port)
    made.get("/")
    return made


@pytest.fixture
def peer(graph_host: GraphHost) -> LupinNode:
    from lupin_runtime.ros import LupinNode

    node: LupinNode = graph_host.add(LupinNode("peer"))
    return node


def journal(folder: Path) -> list[str]:
    return [json.loads(line)["what"] for line in (folder / "console_commands.jsonl").read_text().splitlines()]


# -- locations --------------------------------------------------------------------------------------------------------
def test_locations_of_a_browser_are_added_and_replace_none(browser: Browser) -> None:
    browser.post("/_api/locations", name="table 3", pose=POSE)
    browser.post("/_api/lease", action="give_up")
    found = {"home": HOME, "table 3": HOME, " dock ": POSE, "": POSE, "broken": {"x": "east"}, "x" * 65: POSE}
    expected = {"home": HOME, "dock": POSE, "table 3": POSE}
    assert browser.post("/_api/locations/import", locations=found) == expected
    assert browser.post("/_api/locations/import", locations=found) == expected, "the second time changes nothing"
    assert browser.get("/_api/session")["control"]["holder"] is None, "a page that is opened takes no control"
    assert browser.post("/_api/locations/import", locations={"home": POSE})["home"] == POSE
    for malformed in (None, [POSE], "dock"):
        assert browser.request("POST", "/_api/locations/import", {"locations": malformed})[0] == 400


def test_locations_are_saved_shared_and_removed(browser: Browser, console: Console, tmp_path: Path) -> None:
    assert browser.get("/_api/locations") == {"home": HOME}
    socket = browser.socket("/_api/events")
    assert browser.post("/_api/locations", name="table 3", pose=POSE) == {"home": HOME, "table 3": POSE}
    socket.wait(lambda event: event["event"] == "locations" and "table 3" in event["value"])
    socket.close()
    assert browser.post("/_api/locations", name="home", pose=POSE)["home"] == POSE
    assert Browser(console.port).get("/_api/locations") == {"home": POSE, "table 3": POSE}
    assert browser.post("/_api/locations", name="table 3", pose=None) == {"home": POSE}
    assert browser.post("/_api/locations", name="home", pose=None) == {"home": HOME}
    assert "save location table 3" in journal(tmp_path) and "remove location table 3" in journal(tmp_path)
    assert locations.locations_file().stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    ("name", "pose"),
    [
        ("", POSE),
        ("   ", POSE),
        ("a" * 65, POSE),
        ("a\nb", POSE),
        ("\x1b[31m", POSE),
        ("\u202eevil", POSE),
        (7, POSE),
        (None, POSE),
        ("a", {"x": 1.0}),
        ("a", {**POSE, "x": "1"}),
        ("a", {**POSE, "x": True}),
        ("a", {**POSE, "y": 1e9}),
        ("a", {**POSE, "yaw": float("nan")}),
        ("a", {**POSE, "yaw": float("inf")}),
        ("a", []),
        ("nowhere", None),
    ],
)
def test_malformed_locations_are_refused(browser: Browser, name: Any, pose: Any) -> None:
    status, answer = browser.request("POST", "/_api/locations", {"name": name, "pose": pose})
    assert status == 400 and answer.strip()
    assert browser.get("/_api/locations") == {"home": HOME}


def test_only_session_in_control_changes_shared_data(browser: Browser, console: Console, tmp_path: Path) -> None:
    codes = json.loads((tmp_path / "console.json").read_text())["codes"]
    viewer, operator = (Browser(console.port, proxied=True) for _ in range(2))
    viewer.post("/_api/pair", code=codes["viewer"])
    operator.post("/_api/pair", code=codes["operator"])
    browser.post("/_api/lease", action="take")
    for path, body in (
        ("/_api/locations/import", {"locations": {"a": POSE}}),
        ("/_api/locations", {"name": "a", "pose": POSE}),
        ("/_api/settings", {"settings": {"speedScale": 0.1}}),
        ("/_api/maps", {"name": "mine"}),
        ("/_api/maps/load", {"name": "mine"}),
        ("/_api/maps/delete", {"name": "mine"}),
        ("/_api/maps/relocate", {"pose": POSE}),
        ("/_api/approaches", {"tag": "7", "pose": POSE}),
    ):
        for other in (viewer, operator):
            assert other.request("POST", path, body)[0] == 403
        assert Browser(console.port, proxied=True).request("POST", path, body)[0] == 401
    assert viewer.get("/_api/locations") == {"home": HOME}
    assert viewer.get("/_api/settings")["settings"] == {}


def test_concurrent_writers_lose_no_location(state: Path) -> None:
    file = locations.locations_file()
    writers = [
        threading.Thread(target=lambda n=n: [locations.save_location(file, f"{n}-{k}", POSE) for k in range(10)]) for n in "ab"
    ]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert len(locations.all_locations(file)) == 21
    assert not [path for path in state.iterdir() if path.name.startswith(".")]


def test_number_of_locations_is_limited(tmp_path: Path) -> None:
    file = tmp_path / "locations.json"
    change_object(file, lambda _: {f"n{number}": POSE for number in range(locations.MAX_LOCATIONS)})
    with pytest.raises(locations.BadLocation, match="remove one first"):
        locations.save_location(file, "one more", POSE)
    assert locations.save_location(file, "n7", HOME)["n7"] == HOME


@pytest.mark.parametrize(
    ("path", "content"),
    [
        *[(path, content) for path in ("/_api/locations", "/_api/settings") for content in ("{", "[]", "[" * 100_000, "\xff")],
        ("/_api/locations", '{"a": 1}'),
        ("/_api/locations", '{"a": {"x": NaN, "y": 0, "yaw": 0}}'),
        ("/_api/settings", '{"speedScale": 7}'),
    ],
)
def test_damaged_files_are_named_and_kept(browser: Browser, state: Path, path: str, content: str) -> None:
    file = state / f"{path.rsplit('/', 1)[1]}.json"
    file.write_text(content, encoding="latin-1")
    status, answer = browser.request("GET", path)
    assert status == 503 and str(file) in answer["error"]
    assert file.read_text(encoding="latin-1") == content


# -- settings ---------------------------------------------------------------------------------------------------------
def test_settings_are_changed_for_all_browsers(browser: Browser, console: Console, tmp_path: Path) -> None:
    before = browser.get("/_api/settings")
    assert before["version"] == 5 and before["settings"] == {}
    assert {row["name"]: row["default"] for row in before["table"]}["mapTopic"] == "/map"
    after = browser.post("/_api/settings", settings={"speedScale": 0.25, "armRateDegPerSec": 90})
    assert after["settings"] == {"speedScale": 0.25, "armRateDegPerSec": 90}
    browser.post("/_api/settings", settings={"cameraTopic": "/camera/image_raw"})
    seen = Browser(console.port).get("/_api/settings")["settings"]
    assert seen == {"speedScale": 0.25, "armRateDegPerSec": 90, "cameraTopic": "/camera/image_raw"}
    assert "change settings" in journal(tmp_path)


def test_changing_a_setting_does_not_take_control(browser: Browser) -> None:
    browser.post("/_api/settings", settings={"speedScale": 0.25})
    assert browser.get("/_api/session")["control"]["holder"] is None


def test_settings_of_one_browser_are_not_shared(browser: Browser, state: Path) -> None:
    own = {"theme": "light", "estopAutoOnFocusLoss": False, "voiceLanguage": "nl-NL"}
    assert browser.post("/_api/settings", settings={**own, "speedScale": 0.25})["settings"] == {"speedScale": 0.25}
    # An earlier console stored them.
    (state / "settings.json").write_text(json.dumps({"theme": "pink", "speedScale": 0.75}))
    assert browser.get("/_api/settings")["settings"] == {"speedScale": 0.75}


@pytest.mark.parametrize(
    "changes",
    [
        {"unknown": 1},
        {"speedScale": 2},
        {"speedScale": "0.5"},
        {"speedScale": True},
        {"speedScale": float("nan")},
        {"cmdVelType": "geometry_msgs/msg/Pose"},
        {"cmdVelType": []},
        {"scanTopic": "/scan; rm"},
        {"scanTopic": 7},
        {"webVideoServerUrl": "ws://10.42.0.1:8181"},
        {"webVideoServerUrl": "http://someone:secret@10.42.0.1"},
        {"webVideoServerUrl": "http://10.42.0.1/?topic=/x"},
        {"webVideoServerUrl": "http://10.42.0.1:70000"},
        {"polarityInvertHmi": 1},
        [],
        None,
        "speedScale",
    ],
)
def test_change_with_an_invalid_setting_is_refused_entirely(browser: Browser, changes: Any) -> None:
    both = {"mapTopic": "/map2", **changes} if isinstance(changes, dict) else changes
    status, answer = browser.request("POST", "/_api/settings", {"settings": both})
    assert status == 400 and answer.strip()
    assert browser.get("/_api/settings")["settings"] == {}


@pytest.mark.parametrize("version", [2, 3, 4, 5])
def test_settings_of_earlier_pages_are_migrated(browser: Browser, version: int) -> None:
    stored = {
        "rosUrl": "ws://10.42.0.1:9090",
        "webVideoServerUrl": "http://10.42.0.1:8181",
        "geminiApiKey": "secret",
        "speedScale": 0.75,
        "polarityInvertHmi": True,
        "estopAutoOnFocusLoss": False,
    }
    seen = browser.post("/_api/settings", version=version, settings=stored)["settings"]
    chosen = {"polarityInvertHmi": True, "webVideoServerUrl": "http://10.42.0.1:8181"} if version == 5 else {}
    assert seen == {"speedScale": 0.75, **chosen}
    assert "secret" not in settings.settings_file().read_text()


@pytest.mark.parametrize("version", [1, 6, "5", True, None])
def test_settings_of_other_versions_are_refused(browser: Browser, version: Any) -> None:
    assert browser.request("POST", "/_api/settings", {"version": version, "settings": {}})[0] == 400


# -- services of the robot --------------------------------------------------------------------------------------------
def test_map_is_saved_by_slam_under_a_plain_name(graph_host: GraphHost, browser: Browser, peer: LupinNode, state: Path) -> None:
    from lupin_runtime.ros.interfaces import interface

    asked: list[str] = []

    def save(request: Any, response: Any) -> Any:
        asked.append(request.name.data)
        response.result = len(asked) - 1  # only the first call succeeds
        return response

    peer.create_service(interface(graph.SLAM_SAVE_MAP.type), graph.SLAM_SAVE_MAP.name, save)
    graph_host.until(lambda: browser.request("POST", "/_api/maps", {"name": "green house"})[0] == 200)
    assert asked == [str(state.parent / "maps" / "green house")]
    status, answer = browser.request("POST", "/_api/maps", {"name": "green house"})
    assert status == 409 and "SLAM has not published one" in answer["error"]
    for name in ("../../etc/passwd", "", "a/b", None, "x" * 100):
        assert browser.request("POST", "/_api/maps", {"name": name})[0] == 400
    assert len(asked) == 2


def test_saved_map_can_be_loaded(graph_host: GraphHost, browser: Browser, peer: LupinNode, state: Path, tmp_path: Path) -> None:
    from lupin_runtime.ros.interfaces import interface

    folder = state.parent / "maps"
    loaded: list[tuple[str, int]] = []

    def save(_: Any, response: Any) -> Any:
        response.result = 0
        return response

    def serialize(request: Any, response: Any) -> Any:
        with zipfile.ZipFile(f"{request.filename}.posegraph", "w") as file:
            file.writestr("poses.npy", b"x")
        return save(request, response)

    def load(request: Any, response: Any) -> Any:
        loaded.append((request.filename, request.match_type))
        return response

    rows = ((graph.SLAM_SAVE_MAP, save), (graph.SLAM_SERIALIZE, serialize), (graph.SLAM_DESERIALIZE, load))
    for row, handle in rows:
        peer.create_service(interface(row.type), row.name, handle)
    saved = {"saved": "house", "loadable": True}
    graph_host.until(lambda: browser.request("POST", "/_api/maps", {"name": "house"}) == (200, saved))
    status, answer = browser.request("POST", "/_api/maps", {"name": "house"})
    assert status == 409 and "there is a map house already" in answer["error"]
    assert browser.post("/_api/maps", name="house", replace=True) == saved
    assert browser.post("/_api/maps/load", name="house") == {"loaded": "house"}
    assert loaded == [(str(folder / "house"), 1)]
    (folder / "damaged.posegraph").write_bytes(b"x")
    for name, reason in (("damaged", "damaged.posegraph is damaged"), ("absent", "there is no absent.posegraph")):
        status, answer = browser.request("POST", "/_api/maps/load", {"name": name})
        assert status == 409 and reason in answer["error"]
    for bad in ("../../etc/passwd", "", "a/b", None, "x" * 100):
        assert browser.request("POST", "/_api/maps/load", {"name": bad})[0] == 400
    assert len(loaded) == 1
    assert "load map house" in (tmp_path / "console_commands.jsonl").read_text()


def write_map(folder: Path, name: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.yaml").write_text(f"image: {name}.pgm\n")
    with zipfile.ZipFile(folder / f"{name}.posegraph", "w") as file:
        file.writestr("poses.npy", b"x")


def test_map_stays_while_a_mission_or_a_goal_drives(
    graph_host: GraphHost, browser: Browser, peer: LupinNode, state: Path, tmp_path: Path
) -> None:
    from std_msgs.msg import String

    from lupin_runtime.ros.interfaces import interface

    loaded: list[str] = []

    def load(request: Any, response: Any) -> Any:
        loaded.append(request.filename)
        return response

    write_map(state.parent / "maps", "house")
    peer.create_service(interface(graph.SLAM_DESERIALIZE.type), graph.SLAM_DESERIALIZE.name, load)
    missions, bus = peer.publisher(graph.MISSION_STATE), peer.publisher(graph.DRIVE_STATUS)
    message = interface(graph.MISSION_STATE.type)

    def answer() -> tuple[int, Any]:
        status, found = browser.request("POST", "/_api/maps/load", {"name": "house"})
        return status, found["error"] if status == 409 else found

    missions.publish(message(lifecycle_state="EXPLORING"))
    graph_host.until(lambda: answer()[0] == 409, what="the mission's state")
    assert answer() == (409, "house was not loaded: a mission is running (EXPLORING); abort it first, or wait for its end")
    missions.publish(message(lifecycle_state="INSPECTING", paused=True))
    graph_host.until(lambda: "INSPECTING" in str(answer()[1]), what="a paused mission, whose map stays, too")
    bus.publish(String(data=json.dumps({"winner": "auto"})))
    missions.publish(message(lifecycle_state="DONE"))
    graph_host.until(lambda: "drives to a goal" in str(answer()[1]), what="the drive bus")
    before = len(loaded)
    bus.publish(String(data=json.dumps({"winner": None})))
    graph_host.until(lambda: answer() == (200, {"loaded": "house"}), what="a map that may be replaced")
    assert len(loaded) > before
    rows = [json.loads(line) for line in (tmp_path / "console_commands.jsonl").read_text().splitlines()]
    assert any(row["what"] == "load map house" and "a mission is running" in row.get("refused", "") for row in rows)


def test_saved_map_is_deleted_unless_it_is_loaded(browser: Browser, state: Path, tmp_path: Path) -> None:
    folder = state.parent / "maps"
    for name in ("green house", "hall"):
        write_map(folder, name)
    (tmp_path / "run.json").write_text(json.dumps({"options": {"map_file": str(folder / "hall.yaml")}}))
    (tmp_path / "other.yaml").write_text("x")
    listed = browser.get("/_api/maps")
    assert (listed["folder"], listed["loaded"]) == (str(folder), "hall")
    assert [(each["name"], each["loadable"]) for each in listed["maps"]] == [("green house", True), ("hall", True)]
    command = listed["maps"][0]["command"]
    assert shlex.split(command) == ["lupin", "up", "--map", str(folder / "green house.yaml")]

    def delete(name: Any) -> tuple[int, Any]:
        return browser.request("POST", "/_api/maps/delete", {"name": name})

    assert delete("hall") == (409, {"error": "hall was not deleted: it is the loaded map of this run"})
    (tmp_path / "loaded_map.json").write_text('{"name": "green house"}')
    assert delete("green house")[0] == 409
    assert delete("hall") == (200, {"deleted": "hall"})
    assert delete("hall") == (409, {"error": "hall was not deleted: there is no such map"})
    for bad in ("../../other", "/etc/passwd", "", None, 3, ["hall"]):
        assert delete(bad)[0] == 400
    assert sorted(path.name for path in folder.iterdir()) == ["green house.posegraph", "green house.yaml"]
    assert (tmp_path / "other.yaml").exists()
    assert "delete map hall" in journal(tmp_path)


def test_robot_is_relocated_on_the_present_map(
    graph_host: GraphHost, browser: Browser, peer: LupinNode, state: Path, tmp_path: Path
) -> None:
    from lupin_runtime.ros.interfaces import interface

    results = [1, 0]
    asked: list[tuple[Any, ...]] = []

    def serialize(request: Any, response: Any) -> Any:
        asked.append(("save", request.filename))
        response.result = results.pop(0) if results else 0
        return response

    def load(request: Any, response: Any) -> Any:
        pose = request.initial_pose
        asked.append(("load", request.filename, request.match_type, pose.x, pose.y, pose.theta))
        return response

    for row, handle in ((graph.SLAM_SERIALIZE, serialize), (graph.SLAM_DESERIALIZE, load)):
        peer.create_service(interface(row.type), row.name, handle)
    graph_host.until(lambda: browser.request("POST", "/_api/maps/relocate", {"pose": POSE})[0] == 409)
    assert browser.post("/_api/maps/relocate", pose=POSE) == {"relocated": True}
    path = str(state / "relocation")
    assert asked[-2:] == [("save", path), ("load", path, 2, 1.5, -2.0, 0.5)]
    for bad in (None, {}, {"x": 1.0, "y": 2.0}, {**POSE, "yaw": "north"}):
        assert browser.request("POST", "/_api/maps/relocate", {"pose": bad})[0] == 400
    assert "relocate" in journal(tmp_path)


def test_clients_load_no_map_by_themselves(browser: Browser, console: Console, tmp_path: Path) -> None:
    client = browser.socket()
    for name in (graph.SLAM_DESERIALIZE.name, graph.SLAM_DESERIALIZE.name[1:]):
        answer = client.call(name, filename="/etc/passwd")
        assert answer["result"] is False and "not allowed" in answer["values"]
    client.close()
    viewer = Browser(console.port, proxied=True)
    viewer.post("/_api/pair", code=json.loads((tmp_path / "console.json").read_text())["codes"]["viewer"])
    assert viewer.request("POST", "/_api/maps/load", {"name": "house"})[0] == 403


def test_arm_library_is_forwarded(graph_host: GraphHost, browser: Browser, peer: LupinNode) -> None:
    from lupin_runtime.ros.interfaces import interface

    status, answer = browser.request("GET", "/_api/arm/library")
    assert status == 503 and "does not exist" in answer
    library = {"poses": [{"name": "wave"}], "sequences": []}

    def tell(_: Any, response: Any) -> Any:
        response.success, response.json = True, json.dumps(library)
        return response

    peer.create_service(interface(graph.ARM_LIBRARY_LIST.type), graph.ARM_LIBRARY_LIST.name, tell)
    graph_host.until(lambda: browser.request("GET", "/_api/arm/library")[0] == 200)
    assert browser.get("/_api/arm/library") == library
