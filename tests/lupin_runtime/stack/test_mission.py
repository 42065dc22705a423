"""Complete missions in the simulator: explore, read every tag, dock, report; and the faults that a mission survives."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from tests.lupin_runtime.stack.conftest import Up
from tests.support.console_browser import Browser
from tests.support.waiting import wait_until

pytestmark = [pytest.mark.mission, pytest.mark.sim, pytest.mark.graph]

MISSION_TIMEOUT_S = 900.0
# One table and two tags, on opposite sides of it: the smallest greenhouse that has to be explored, read and left again.
SMALL_GREENHOUSE: dict[str, Any] = {
    "tables": {"table": {"x0": 0.0, "x1": 1.0, "y0": 0.0, "y1": 0.4}},
    "tags": {"1": {"x": 0.5, "y": 0.0, "sensors": ["temperature"]}, "2": {"x": 0.5, "y": 0.4, "sensors": ["humidity", "co2"]}},
}
RESTARTABLE = ("perception", "twin", "recorder", "body", "estop", "drive", "nav", "slam")


def speed_m_s(run: Any) -> float:
    """Return the robot's true speed."""
    twist = run.simulator().get("twist") or [0.0, 0.0, 0.0]
    return float((twist[0] ** 2 + twist[1] ** 2) ** 0.5)


def until_moving(run: Any) -> None:
    """Wait until the robot drives."""
    wait_until(lambda: speed_m_s(run) >= 0.1, lambda: f"a robot that drives: {run.state().get('mission')}")


@pytest.mark.smoke
@pytest.mark.usefixtures("console_ports")
def test_small_mission_shows_its_page_and_writes_a_report(launch: Callable[..., Up], tmp_path: Path) -> None:
    layout = tmp_path / "small.json"
    layout.write_text(json.dumps(SMALL_GREENHOUSE))
    run = launch("--mission", "--headless", "--json", "--world", str(layout), "--web")
    run.until(lambda state: state["mission"].get("lifecycle_state") == "EXPLORING", "exploration")
    folder = run.folder()
    assert folder is not None
    described = read_description(folder)
    assert described is not None
    browser = Browser(described.port)
    assert '<div id="root">' in browser.get("/")
    assert folder.name in [each["id"] for each in browser.get("/_api/runs")]
    page = browser.socket()
    page.send("subscribe", topic=graph.MISSION_STATE.name)
    assert page.publication(graph.MISSION_STATE.name)["mission_id"] == run.state()["mission"]["mission_id"]
    page.close()

    status, result = run.result(MISSION_TIMEOUT_S)
    assert (status, result["state"]) == (0, "DONE"), result
    assert result["tags_found"] == result["tags_read"] == result["tags_reachable"] == len(SMALL_GREENHOUSE["tags"])
    assert result["collisions"] == 0
    report = Path(result["report"])
    assert "</html>" in report.read_text()
    read = [tag for tag in json.loads(report.with_suffix(".json").read_text())["tags"] if tag["outcome"] == "read"]
    assert len(read) == len(SMALL_GREENHOUSE["tags"]) and all(tag["readings"] for tag in read)


def test_mission_reads_every_tag_and_writes_a_report(launch: Callable[..., Any]) -> None:
    run = launch("--mission", "--headless", "--json", "--world", "random:1")
    status, result = run.result(MISSION_TIMEOUT_S)
    assert (status, result["state"]) == (0, "DONE"), result
    assert result["tags_found"] == result["tags_read"] == result["tags_reachable"] > 0
    assert result["collisions"] == 0
    assert result["trajectory_rmse_m"] <= 0.05
    assert result["tag_error_median_m"] <= 0.05
    page = Path(result["report"])
    assert "</html>" in page.read_text()
    report = json.loads(page.with_suffix(".json").read_text())
    assert all(tag["readings"] for tag in report["tags"] if tag["outcome"] == "read")


def test_mission_survives_process_deaths_and_an_estop(launch: Callable[..., Any]) -> None:
    run = launch("--mission", "--headless", "--json", "--world", "walled")
    run.until(lambda state: state["mission"].get("lifecycle_state") == "EXPLORING", "exploration")
    for name in RESTARTABLE:
        until_moving(run)
        killed = run.kill(name)
        run.until(
            # state.json calls the processes stages.
            lambda state, name=name, killed=killed: any(
                process["name"] == name and process["phase"] == "up" and process["pid"] != killed for process in state["stages"]
            ),
            f"restart of {name}",
        )
    until_moving(run)
    assert run.lupin("sim", "press", "estop").returncode == 0
    run.wait(lambda: speed_m_s(run) < 0.005, "rest after the press")
    run.until(lambda state: state["mission"]["estop_engaged"] and state["mission"]["paused"], "pause by e-stop")
    assert run.lupin("sim", "press", "estop", "--release").returncode == 0
    run.until(lambda state: not state["mission"]["estop_engaged"], "released e-stop")
    # Releasing the e-stop must not start motion.
    for _ in range(10):
        assert speed_m_s(run) < 0.005 and run.state()["mission"]["paused"]
        time.sleep(0.2)
    assert run.lupin("mission", "resume").returncode == 0
    status, result = run.result(MISSION_TIMEOUT_S)
    assert (status, result["state"]) == (0, "DONE"), result
    # One tag of the world `walled` is unreachable.
    assert result["tags_read"] == result["tags_reachable"] == result["tags_total"] - 1
    assert result["collisions"] == 0


def test_crash_of_process_mission_ends_the_run_at_rest(launch: Callable[..., Any]) -> None:
    run = launch("--mission", "--headless", "--json", "--world", "walled")
    run.until(lambda state: state["mission"].get("lifecycle_state") == "EXPLORING", "exploration")
    until_moving(run)
    run.kill("mission")
    status, result = run.result(120.0)
    assert (status, result["state"]) == (1, "LOST")
    # The simulator, which is stopped last, writes its state once more when it ends.
    assert speed_m_s(run) < 0.005, run.simulator()
    kept = json.loads((Path(result["report"]).parents[1] / "result.json").read_text())
    assert [death["stage"] for death in kept["outcome"]["deaths"]] == ["mission"]
