"""Port 8090 on a real graph: pairing, sessions, control and stop, with browsers that keep their cookies."""

from __future__ import annotations

import json
import re
import socket
import ssl
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

import lupin_runtime
from lupin_runtime import graph
from lupin_runtime.console import dual_port
from lupin_runtime.console.authority import Role
from lupin_runtime.console.sessions import Sessions
from lupin_runtime.console.shared_file import locked
from tests.support.console_browser import Browser, stop_texts
from tests.support.rosbridge_client import RosbridgeClient
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

Open = Callable[..., RosbridgeClient]


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    from lupin_runtime.console.node import Console

    files = {"folder": str(tmp_path), "sessions_file": str(tmp_path / "sessions.json")}
    node = graph_host.add(Console({"port": 0, "rosbridge_port": 0, **files}))
    yield node
    node.before_shutdown()


@pytest.fixture
def peer(graph_host: GraphHost) -> LupinNode:
    from lupin_runtime.ros import LupinNode

    node: LupinNode = graph_host.add(LupinNode("peer"))
    return node


@pytest.fixture
def open_socket() -> Iterator[Open]:
    """Opens WebSockets that are closed after the test."""
    made: list[RosbridgeClient] = []

    def new(browser: Browser, path: str = "/_ros") -> RosbridgeClient:
        made.append(browser.socket(path))
        return made[-1]

    yield new
    for client in made:
        client.close()


@pytest.fixture
def phone(console: Console) -> Browser:
    """An unpaired browser on another computer."""
    return Browser(console.port, proxied=True)


def code(folder: Path, role: str = "operator") -> str:
    """Return the code that the terminal shows."""
    return str(json.loads((folder / "console.json").read_text())["codes"][role])


def journal(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "console_commands.jsonl").read_text().splitlines()]


# -- pairing ----------------------------------------------------------------------------------------------------------
def test_unpaired_browser_on_another_computer_gets_nothing(phone: Browser, open_socket: Open) -> None:
    assert "<title>Lupin</title>" in phone.get("/")
    assert phone.get("/_api/session")["session"] is None
    for path, body in (("/_api/lease", {"action": "take"}), ("/_api/stop", {"engaged": True})):
        status, answer = phone.request("POST", path, body)
        assert status == 401 and "not paired" in answer["error"]
    for path in ("/_ros", "/_api/events"):
        with pytest.raises(InvalidStatus, match="401"):
            open_socket(phone, path)
    assert "Cookie" not in phone.headers


def test_only_operators_at_this_computer_see_codes(console: Console, phone: Browser, tmp_path: Path) -> None:
    local = Browser(console.port)
    local.get("/")
    shown = local.get("/_api/access")
    assert shown["serves_only_this_computer"] and shown["urls"] == [], "it listens on 127.0.0.1"
    assert shown["codes"]["viewer"].replace("-", "") == code(tmp_path, "viewer")
    assert phone.request("GET", "/_api/access")[0] == 401
    phone.post("/_api/pair", code=shown["codes"]["operator"])
    assert phone.get("/_api/access")["codes"] == {}
    viewer = Browser(console.port)
    viewer.post("/_api/pair", code=code(tmp_path, "viewer"))
    assert viewer.get("/_api/access")["codes"] == {}


def test_code_pairs_one_browser_once(phone: Browser, console: Console, tmp_path: Path, open_socket: Open) -> None:
    first = code(tmp_path)
    assert phone.post("/_api/pair", code=first) == {"name": "phone-1", "role": "operator"}
    cookie = phone.response_headers["Set-Cookie"]
    assert all(part in cookie for part in ("HttpOnly", "SameSite=Strict", "Path=/", "Max-Age="))
    assert phone.get("/_api/session")["session"] == {"name": "phone-1", "role": "operator"}
    assert open_socket(phone).call("/rosapi/get_ros_version")["result"]
    assert code(tmp_path) != first, "the terminal shows the next one"
    status, answer = Browser(console.port, proxied=True).request("POST", "/_api/pair", {"code": first})
    assert status == 403 and "wrong, used or expired" in answer["error"]
    assert [row["what"] for row in journal(tmp_path)] == ["paired as operator", "/_api/pair"]
    assert first not in (tmp_path / "console_commands.jsonl").read_text()


def test_browser_paired_again_has_one_session(phone: Browser, tmp_path: Path) -> None:
    phone.post("/_api/pair", code=code(tmp_path, "viewer"))
    before = phone.headers["Cookie"]
    assert phone.post("/_api/pair", code=code(tmp_path))["role"] == "operator"
    assert len(Sessions(tmp_path / "sessions.json").all()) == 1
    phone.headers["Cookie"] = before
    assert phone.get("/_api/session")["session"] is None


def test_browser_on_this_computer_is_paired_automatically(console: Console, tmp_path: Path) -> None:
    browser, other = Browser(console.port, agent="Mozilla/5.0 (X11; Linux x86_64)"), Browser(console.port)
    browser.get("/")
    other.get("/")
    assert browser.get("/_api/session")["session"] == {"name": "computer-1", "role": "operator"}
    assert other.get("/_api/session")["session"]["name"] == "phone-1"
    browser.get("/")
    assert len(Sessions(tmp_path / "sessions.json").all()) == 2


@pytest.mark.parametrize(
    "headers",
    [
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"},
        {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"},
        {"Sec-Fetch-Site": "none", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe"},
    ],
)
def test_page_of_another_site_pairs_no_browser(console: Console, tmp_path: Path, headers: dict[str, str]) -> None:
    browser = Browser(console.port)
    browser.get("/", **headers)
    assert "Cookie" not in browser.headers
    assert not (tmp_path / "sessions.json").exists()
    browser.get("/", **{"Sec-Fetch-Site": "none", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"})
    assert "Cookie" in browser.headers


def test_program_on_this_computer_keeps_no_session(console: Console, tmp_path: Path) -> None:
    program = Browser(console.port, agent="curl/8")
    program.headers["Accept"] = "*/*"
    program.get("/")
    assert program.get("/_api/session")["session"]["name"] == "this computer"
    assert not (tmp_path / "sessions.json").exists()


def test_program_on_another_computer_needs_a_pairing_token(phone: Browser, console: Console, tmp_path: Path) -> None:
    def connect(headers: dict[str, str]) -> RosbridgeClient:
        return RosbridgeClient(console.rosbridge_port, additional_headers={"X-Forwarded-For": "192.0.2.7", **headers})

    for headers in ({}, {"Cookie": "lupin_session=guessed"}):
        with pytest.raises(InvalidStatus, match="403"):
            connect(headers)
    phone.post("/_api/pair", code=code(tmp_path, "viewer"))
    program = connect({"Cookie": phone.headers["Cookie"]})
    assert program.call("/rosapi/get_ros_version")["result"]
    program.send("set_level", level="error")
    program.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    program.refusal("phone-1 is a viewer")
    assert Sessions(tmp_path / "sessions.json").revoke("phone-1")
    with pytest.raises(ConnectionClosed, match="no longer paired"):
        program.take(20.0)


def test_revoked_browser_is_disconnected(phone: Browser, tmp_path: Path, open_socket: Open) -> None:
    phone.post("/_api/pair", code=code(tmp_path))
    client = open_socket(phone)
    assert client.call("/rosapi/get_ros_version")["result"]
    assert Sessions(tmp_path / "sessions.json").revoke("phone-1")
    with pytest.raises(ConnectionClosed, match="no longer paired"):
        client.take(20.0)
    with pytest.raises(InvalidStatus, match="401"):
        open_socket(phone)


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example"])
def test_unknown_name_for_this_computer_is_refused(console: Console, host: str) -> None:
    status, text = Browser(console.port).request("GET", "/_api/session", Host=host)
    assert status == 421 and host in text


def test_page_of_another_site_can_do_nothing(console: Console) -> None:
    browser = Browser(console.port)
    browser.get("/")
    for origin in ("https://evil.example", "null", f"https://127.0.0.1:{console.port}"):
        status, _ = browser.request("POST", "/_api/stop", {"engaged": True}, Origin=origin)
        assert status == 403
        with pytest.raises(InvalidStatus, match="403"):
            RosbridgeClient(console.port, "/_ros", origin=origin, additional_headers={"Cookie": browser.headers["Cookie"]})


@pytest.mark.parametrize("path", ["/_api/pair", "/_api/lease", "/_api/stop"])
@pytest.mark.parametrize("body", [b"", b"{", b"[]", b"3", b"{}", b'{"code": 3, "action": [], "engaged": "x"}', b"[" * 5000])
def test_bad_request_is_refused_with_its_reason(console: Console, path: str, body: bytes) -> None:
    status, text = Browser(console.port).request("POST", path, body)
    assert status == 400 and text


def test_page_runs_only_own_scripts_and_refuses_frames(console: Console) -> None:
    browser = Browser(console.port)
    browser.get("/")
    policy = browser.response_headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy and "frame-ancestors 'none'" in policy and "unsafe" not in policy
    for path in ("/page/../origin.py", "/page/%2e%2e/origin.py", "/page//etc/passwd", "/page/"):
        assert browser.request("GET", path)[0] in (403, 404)


def test_installed_page_is_served_and_only_its_assets_are_cached(console: Console) -> None:
    browser = Browser(console.port)
    page = Path(lupin_runtime.__file__).parent / "console" / "page"
    index = browser.get("/")
    assert index == (page / "index.html").read_text(encoding="utf-8")
    assert browser.response_headers["Cache-Control"] == "no-store"
    assets = re.findall(r'(?:src|href)="/page/(assets/[^"]+)"', index)
    assert any(path.endswith(".js") for path in assets) and any(path.endswith(".css") for path in assets)
    for path in assets:
        assert browser.get(f"/page/{path}") == (page / path).read_text(encoding="utf-8")
        assert "immutable" in browser.response_headers["Cache-Control"]
    status, _ = browser.request("GET", "/page/assets/old-build.js")
    assert status == 404 and browser.response_headers["Cache-Control"] == "no-store"


def test_silent_client_does_not_block_others(console: Console) -> None:
    silent = [socket.create_connection(("127.0.0.1", console.port), timeout=60) for _ in range(100)]
    assert Browser(console.port).get("/_api/session")["session"]
    for connection in silent:
        connection.close()


def test_damaged_session_file_blocks_pairing_but_not_the_stop(phone: Browser, console: Console, tmp_path: Path) -> None:
    phone.post("/_api/pair", code=code(tmp_path))
    (tmp_path / "sessions.json").write_text("{")
    assert phone.post("/_api/stop", engaged=True)["stop"]
    status, answer = Browser(console.port, proxied=True).request("POST", "/_api/pair", {"code": code(tmp_path)})
    assert status == 503 and "sessions.json" in answer["error"]


def openings(path: Path) -> int:
    """Return how often this process has a file open."""
    return [file.path for file in psutil.Process().open_files()].count(str(path))


def test_stop_does_not_wait_for_slow_disk(phone: Browser, console: Console, tmp_path: Path) -> None:
    phone.post("/_api/pair", code=code(tmp_path))
    with ThreadPoolExecutor() as pool:
        with locked(tmp_path / "sessions.json"):
            joining = Browser(console.port, proxied=True)
            waiting = pool.submit(joining.request, "POST", "/_api/pair", {"code": code(tmp_path)})
            wait_until(lambda: openings(tmp_path / "sessions.lock") == 2, "the pairing at the lock")
            assert phone.post("/_api/stop", engaged=True)["stop"]
            assert not waiting.done(), "the pairing is still waiting for the lock"
        assert waiting.result(20.0)[0] == 200


def test_browser_on_another_computer_is_sent_to_https(
    graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lupin_runtime.console.certificate import CertificateStore
    from lupin_runtime.console.node import Console

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    node = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "folder": str(tmp_path), "tls": True}))
    try:
        phone = Browser(node.port, proxied=True)
        assert phone.request("GET", "/?x=1")[0] == 308
        assert phone.response_headers["Location"] == f"https://127.0.0.1:{node.port}/?x=1"
        assert phone.request("POST", "/_api/pair", {"code": code(tmp_path)})[0] == 403
        assert Browser(node.port).get("/_api/session")["session"], "this computer needs no encryption"
        trust = ssl.create_default_context(cafile=CertificateStore().root_path)
        secure = Browser(node.port, proxied=True, trust=trust)
        assert secure.post("/_api/pair", code=code(tmp_path))["role"] == "operator"
        assert "Secure" in secure.response_headers["Set-Cookie"]
        secure.headers.pop("Cookie")
        assert secure.get("/authority.crt") == CertificateStore().root_path.read_text(), (
            "a phone fetches it before it is paired"
        )
        assert secure.response_headers["Content-Type"] == "application/x-x509-ca-cert"
        secure.post("/_api/pair", code=code(tmp_path))
        client = secure.socket()
        assert client.call("/rosapi/get_ros_version")["result"]
        client.close()
    finally:
        node.before_shutdown()


# -- control ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def anne(console: Console, tmp_path: Path) -> Browser:
    browser = Browser(console.port, proxied=True)
    browser.post("/_api/pair", code=code(tmp_path))
    return browser


@pytest.fixture
def ben(console: Console, tmp_path: Path, anne: Browser) -> Browser:
    assert anne is not None  # the first phone
    browser = Browser(console.port, proxied=True)
    browser.post("/_api/pair", code=code(tmp_path))
    return browser


def test_control_is_requested_and_handed_over(anne: Browser, ben: Browser, open_socket: Open) -> None:
    events = open_socket(anne, "/_api/events")
    assert anne.post("/_api/lease", action="take")["holder"] == "phone-1"
    status, answer = ben.request("POST", "/_api/lease", {"action": "take"})
    assert status == 403 and "phone-1 has had control" in answer["error"]
    assert ben.post("/_api/lease", action="request")["requester"] == "phone-2"
    events.wait(lambda event: event["event"] == "control" and event["value"]["requester"] == "phone-2")
    assert anne.post("/_api/lease", action="grant")["holder"] == "phone-2"
    events.wait(lambda event: event["event"] == "control" and event["value"]["holder"] == "phone-2")


def test_everybody_sees_who_is_connected(anne: Browser, ben: Browser, open_socket: Open) -> None:
    def is_here(*names: str) -> Callable[[dict[str, Any]], bool]:
        here = [{"name": name, "role": "operator"} for name in names]
        return lambda event: event == {"event": "browsers", "value": here}

    events = open_socket(anne, "/_api/events")
    events.wait(is_here("phone-1"))
    other = open_socket(ben, "/_api/events")
    open_socket(ben, "/_ros")  # the second socket of one browser
    events.wait(is_here("phone-1", "phone-2"))
    other.wait(is_here("phone-1", "phone-2"))


def test_control_is_taken_over_only_from_the_named_holder(anne: Browser, ben: Browser, tmp_path: Path) -> None:
    anne.post("/_api/lease", action="take")
    status, answer = ben.request("POST", "/_api/lease", {"action": "take_over", "from": "phone-7"})
    assert status == 409 and "phone-1" in answer["error"]
    assert ben.post("/_api/lease", action="take_over", **{"from": "phone-1"})["holder"] == "phone-2"
    assert journal(tmp_path)[-1]["what"] == "phone-2 has control, taken from phone-1"


def test_taking_over_stops_the_previous_driver(
    graph_host: GraphHost, peer: LupinNode, anne: Browser, ben: Browser, open_socket: Open
) -> None:
    speeds: list[float] = []
    peer.subscription(graph.CMD_VEL_MANUAL, lambda message: speeds.append(message.linear.x))
    graph_host.until(lambda: peer.count_publishers(graph.CMD_VEL_MANUAL.name))
    driver, next_driver = open_socket(anne), open_socket(ben)
    driver.send("set_level", level="error")
    driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    graph_host.until(lambda: speeds == [0.2], what="the first driver's velocity")
    driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    ben.post("/_api/lease", action="take_over", **{"from": "phone-1"})
    graph_host.until(lambda: speeds[-1] == 0.0, what="the robot at rest")
    driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    driver.refusal("phone-2 has had control")
    next_driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.1}})
    graph_host.until(lambda: speeds[-1] == 0.1, what="the next driver's velocity")


def test_viewer_watches_and_stops_but_does_not_drive(
    graph_host: GraphHost, peer: LupinNode, console: Console, tmp_path: Path, anne: Browser, open_socket: Open
) -> None:
    stops: list[bool] = []
    peer.subscription(graph.CONSOLE_STOP, lambda message: stops.append(json.loads(message.data)["engaged"]))
    graph_host.until(lambda: peer.count_publishers(graph.CONSOLE_STOP.name))
    viewer = Browser(console.port, proxied=True)
    viewer.post("/_api/pair", code=code(tmp_path, Role.VIEWER.value))
    for action in ("take", "request"):
        assert viewer.request("POST", "/_api/lease", {"action": action})[0] == 403
    client = open_socket(viewer)
    client.send("set_level", level="error")
    client.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    client.refusal("is a viewer")
    assert stop_texts(viewer.post("/_api/stop", engaged=True)) == ["phone-2 stopped the robot"]
    graph_host.until(lambda: stops and stops[-1], what="the stop")
    assert viewer.request("POST", "/_api/stop", {"engaged": False})[0] == 403
    client.close()
    assert anne.post("/_api/stop", engaged=False)["stop"] == []
    graph_host.until(lambda: not stops[-1], what="the stop to be released")


def test_session_without_control_lets_go_of_its_own_stop(anne: Browser, ben: Browser) -> None:
    anne.post("/_api/lease", action="take")
    ben.post("/_api/stop", engaged=True, press="press:1")
    anne.post("/_api/stop", engaged=True, press="press:2")
    assert ben.request("POST", "/_api/stop", {"engaged": False, "presses": ["press:1"]})[0] == 403
    assert len(ben.post("/_api/stop", engaged=False, press="press:2")["stop"]) == 2, "another's press"
    answer = ben.post("/_api/stop", engaged=False, press="press:1")
    assert stop_texts(answer) == ["phone-1 stopped the robot"]
    anne.post("/_api/lease", action="give_up")
    ben.post("/_api/stop", engaged=False, press="press:1")
    assert ben.get("/_api/session")["control"]["holder"] is None, "letting go takes no control"


def test_control_releases_the_stops_that_it_has_seen(anne: Browser, ben: Browser, open_socket: Open) -> None:
    client, events = open_socket(ben), open_socket(anne, "/_api/events")
    client.send("set_level", level="warning")

    def press(name: str) -> None:
        client.send("publish", topic="/lupin/hmi/estop", msg={"data": True}, id=name)

    def seen(name: str) -> Any:
        return events.wait(lambda event: event["event"] == "stop" and [hold["press"] for hold in event["value"]] == [name])

    press("press:1")
    (hold,) = seen("press:1")["value"]
    assert (hold["kind"], hold["name"], hold["age_s"]) == ("pressed", "phone-2", 0)
    press("press:2")
    seen("press:2")
    answer = anne.post("/_api/stop", engaged=False, presses=["press:1"])
    assert stop_texts(answer) == ["phone-2 holds the stop"], "the operator has not seen the newer press"
    assert anne.post("/_api/stop", engaged=False, presses=["press:2"])["stop"] == []

    press("press:2")
    told = client.wait(lambda message: message["op"] == "status")
    assert (told["level"], told["msg"], told["id"]) == ("warning", "phone-1", "press:2")
    assert anne.get("/_api/session")["stop"] == [], "what the page repeats before it knows engages nothing"
    press("press:3")
    seen("press:3")


def test_stop_and_release_need_well_formed_bodies(anne: Browser) -> None:
    for body in ({}, {"engaged": 1}, {"engaged": False, "presses": "press:1"}, {"engaged": False, "presses": [1]}):
        assert anne.request("POST", "/_api/stop", body)[0] == 400
    assert stop_texts(anne.post("/_api/stop", engaged=True, press=[1])) == ["phone-1 stopped the robot"], "a stop is a stop"


def test_viewer_lets_go_of_its_own_stop(console: Console, tmp_path: Path, anne: Browser, open_socket: Open) -> None:
    viewer = Browser(console.port, proxied=True)
    viewer.post("/_api/pair", code=code(tmp_path, Role.VIEWER.value))
    client = open_socket(viewer)
    viewer.post("/_api/stop", engaged=True, press="press:1")
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": True}, id="press:1")
    anne.post("/_api/stop", engaged=True)
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": False}, id="press:1")
    assert client.call("/rosapi/get_ros_version")["result"]
    assert stop_texts(anne.get("/_api/session")) == ["phone-1 stopped the robot"]


def test_stick_at_rest_takes_no_control(
    graph_host: GraphHost, peer: LupinNode, anne: Browser, ben: Browser, open_socket: Open
) -> None:
    speeds: list[float] = []
    peer.subscription(graph.CMD_VEL_MANUAL, lambda message: speeds.append(message.linear.x))
    graph_host.until(lambda: peer.count_publishers(graph.CMD_VEL_MANUAL.name))
    resting, driver = open_socket(anne), open_socket(ben)
    resting.send("set_level", level="error")
    resting.send("publish", topic="/cmd_vel_manual", msg={})
    graph_host.until(lambda: speeds == [0.0], what="the stick at rest")
    assert ben.get("/_api/session")["control"]["holder"] is None
    driver.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.1}})
    graph_host.until(lambda: speeds[-1] == 0.1, what="the driver's velocity")
    resting.send("publish", topic="/cmd_vel_manual", msg={})
    resting.refusal("phone-2 has had control")


def test_commands_are_logged_with_their_session(anne: Browser, tmp_path: Path, open_socket: Open) -> None:
    client = open_socket(anne)
    client.send("set_level", level="error")
    client.send("publish", topic="/cmd_vel", msg={})
    client.refusal("not allowed")
    client.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.1}})
    client.call("/mission/pause")
    anne.post("/_api/stop", engaged=True)
    by_phone = [row for row in journal(tmp_path) if row["session"] == "phone-1"]
    assert [row["what"] for row in by_phone] == [
        "paired as operator",
        "publish /cmd_vel",
        "phone-1 has control",
        "drive",
        "call /mission/pause",
        "phone-1 stopped the robot",
    ]
    assert "not allowed" in by_phone[1]["refused"]


def test_two_hundred_paired_clients_of_one_address_are_served(
    graph_host: GraphHost, console: Console, tmp_path: Path, open_socket: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As if all of them came from another computer.
    monkeypatch.setattr(dual_port, "_is_loopback", lambda _: False)
    browser = Browser(console.port, proxied=True)
    browser.post("/_api/pair", code=code(tmp_path))
    clients = [open_socket(browser) for _ in range(200)]
    for client in clients:
        client.send("subscribe", topic="/shared", type="std_msgs/String")
    assert clients[-1].call("/rosapi/get_ros_version")["result"]
    assert console.count_subscribers("/shared") == 1
    for client in clients:
        client.close()
    graph_host.until(lambda: console.count_subscribers("/shared") == 0, what="the end of all subscriptions")


def test_history_has_stops_and_changes_of_control(phone: Browser, open_socket: Open, tmp_path: Path) -> None:
    phone.post("/_api/pair", code=code(tmp_path))
    events = open_socket(phone, "/_api/events")
    phone.post("/_api/lease", action="take")
    phone.post("/_api/stop", engaged=True, press="press:1")
    phone.post("/_api/stop", engaged=False, presses=["press:1"])
    events.wait(lambda event: event["event"] == "event" and event["value"]["kind"] == "stop_released")
    kinds = ["control_taken", "stop_left", "stop_released"]
    history = phone.get("/_api/history")["events"]
    assert [event["kind"] for event in history] == kinds and {event["name"] for event in history} == {"phone-1"}
    rows = [json.loads(line) for line in (tmp_path / "console_commands.jsonl").read_text().splitlines()]
    assert [row["event"] for row in rows if "event" in row] == history


def test_history_has_the_log_since_the_start(phone: Browser, peer: LupinNode, graph_host: GraphHost, tmp_path: Path) -> None:
    phone.post("/_api/pair", code=code(tmp_path))
    peer.get_logger().warning("the first line")
    graph_host.until(
        lambda: any(row["msg"] == "the first line" for row in phone.get("/_api/history/log")), what="the line in the history"
    )
