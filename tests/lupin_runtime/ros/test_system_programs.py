"""Programs of the distribution end together, and the reason is what the log says last."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lupin_runtime.stack.engines import NAV2
from tests.support.stand_in_engines import install

if TYPE_CHECKING:
    from tests.conftest import GraphHost

CONTROLLER = """#!/bin/sh
while [ ! -e "{ready}" ]; do sleep 0.02; done
exit 3
"""
PLANNER = """#!/bin/sh
trap 'echo "rclpy.LateError: terminated" >&2; exit 1' TERM
touch "{ready}"
while :; do sleep 0.02; done
"""


@pytest.mark.graph
@pytest.mark.usefixtures("graph_host")
def test_programs_have_ended_once_the_death_of_one_is_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from lupin_runtime.ros.system_programs import ProgramError, SystemPrograms

    prefix = install(tmp_path / "ros", [NAV2])
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    for path, script in (("nav2_controller/controller_server", CONTROLLER), ("nav2_planner/planner_server", PLANNER)):
        (prefix / "lib" / path).write_text(script.format(ready=tmp_path / "ready"))
    programs = ["nav2_controller/controller_server/controller_server", "nav2_planner/planner_server/planner_server"]
    node = SystemPrograms("engines", {}, {}, {"programs": programs, "parameter_file": str(tmp_path / "parameters.yaml")})
    try:
        controller, planner = (program.process for program in node._running)
        assert controller.wait() == 3 and planner.poll() is None
        with pytest.raises(ProgramError, match="controller_server exited with status 3"):
            node._step()
        assert planner.poll() == 1 and "rclpy.LateError" in capfd.readouterr().err
    finally:
        node.before_shutdown()
        node.destroy_node()


@pytest.mark.graph
@pytest.mark.parametrize(
    ("timeout_s", "reason"),
    [(60.0, "planner_server did not configure"), (0.0, "planner_server did not answer a request to configure")],
)
def test_programs_have_ended_once_one_does_not_become_active(
    timeout_s: float, reason: str, graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lifecycle_msgs.srv import ChangeState
    from rclpy.executors import SingleThreadedExecutor

    from lupin_runtime.ros import LupinNode, system_programs

    prefix = install(tmp_path / "ros", [NAV2])
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    monkeypatch.setattr(system_programs, "ANSWER_TIMEOUT_S", timeout_s)
    (prefix / "lib/nav2_planner/planner_server").write_text(PLANNER.format(ready=tmp_path / "ready"))
    host = graph_host.add(LupinNode("planner_server"))
    host.create_service(ChangeState, "/planner_server/change_state", lambda _, response: response)  # without success
    programs = {"programs": ["nav2_planner/planner_server/planner_server"], "parameter_file": str(tmp_path / "p.yaml")}
    node = system_programs.SystemPrograms("engines", {}, {}, programs)
    executor = SingleThreadedExecutor()
    try:
        executor.add_node(node)
        with pytest.raises(system_programs.ProgramError, match=reason):
            executor.spin()
        assert node._running[0].process.poll() is not None
    finally:
        node.before_shutdown()
        executor.remove_node(node)
        executor.shutdown()
        node.destroy_node()
