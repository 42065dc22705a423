"""`lupin mission`: the diagram, and an operator's requests with and without a run."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

from lupin_cli.commands.mission import app
from lupin_runtime.mission.diagram import FORMATS, draw
from lupin_runtime.mission.diagram_model import build_diagram
from lupin_runtime.mission.hsm_spec import StateSpec, TransitionSpec, build_hsm_spec

runner = CliRunner()
ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("form", list(FORMATS))
def test_every_diagram_shows_all_states_and_triggers(form: str) -> None:
    result = runner.invoke(app, ["diagram", "--format", form])
    assert result.exit_code == 0
    spec = build_hsm_spec()
    for word in {t.trigger for t in spec.transitions} | {leaf.split(".")[-1] for leaf in spec.leaves()}:
        assert re.search(rf"\b{word}\b", result.stdout), word


def test_svg_texts_are_inside_the_picture() -> None:
    root = ElementTree.fromstring(draw(build_hsm_spec(), "svg"))
    width, height = float(root.attrib["width"]), float(root.attrib["height"])
    texts = [e for e in root.iter() if e.tag.endswith("text")]
    assert len(texts) > 30
    for text in texts:
        half = 3.2 * len(text.text or "")
        x, y = float(text.attrib["x"]), float(text.attrib["y"])
        assert half <= x <= width - half and 0.0 < y < height, text.text


def test_state_without_position_is_drawn() -> None:
    from dataclasses import replace

    spec = build_hsm_spec()
    spec = replace(
        spec,
        states=(*spec.states, StateSpec("CHARGING")),
        transitions=(*spec.transitions, TransitionSpec("deps_up", ("RETURNING",), "CHARGING")),
    )
    for form in FORMATS:
        assert "CHARGING" in draw(spec, form)


def test_arrows_from_every_leaf_leave_the_composite() -> None:
    found = {(arrow.source, arrow.dest): arrow.text for arrow in build_diagram(build_hsm_spec()).arrows}
    assert found[("INSPECTING", "RETURNING")] == "abort_to_return"
    assert ("INSPECTING.SCANNING", "RETURNING") not in found
    assert found[("INSPECTING.PUBLISHING", "RETURNING")] == "inspection_complete"


def test_diagram_writes_file_and_rejects_unknown_format(tmp_path: Path) -> None:
    target = tmp_path / "mission.svg"
    assert runner.invoke(app, ["diagram", "-f", "svg", "-o", str(target)]).exit_code == 0
    assert target.read_text().startswith("<svg")
    wrong = runner.invoke(app, ["diagram", "--format", "png"])
    assert wrong.exit_code == 2
    assert "mermaid, dot, svg, ascii" in wrong.stderr
    nowhere = runner.invoke(app, ["diagram", "-o", str(tmp_path / "no" / "where.svg")])
    assert nowhere.exit_code == 1
    assert "cannot write" in nowhere.stderr


def test_requests_without_run_say_how_to_start_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for verb in ("start", "pause", "resume", "abort", "skip", "dock", "reset", "status"):
        result = runner.invoke(app, [verb])
        assert result.exit_code == 3, verb
        assert "lupin up" in result.stderr


@pytest.mark.usefixtures("private_graph")
@pytest.mark.graph
def test_requests_reach_live_mission_and_refusals_set_status(
    graph_host: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lupin_runtime.mission.node import MissionOrchestrator
    from lupin_runtime.stack.runs import create_run

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    run, lock = create_run()
    names = ("ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE")
    run.write_info({"environment": {name: os.environ[name] for name in names}})
    run.write_state({"mission": {"lifecycle_state": "BOOT"}})
    node = graph_host.add(MissionOrchestrator())

    def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "lupin_cli.app", "mission", *arguments],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=60,
        )

    try:
        status = lupin("status", "--json")
        assert json.loads(status.stdout)["lifecycle_state"] == "BOOT"
        paused = lupin("pause")
        assert (paused.returncode, paused.stderr.strip()) == (1, "no mission is running")
        refused = lupin("start", "--discovery-goal", "all")
        assert refused.returncode == 1
        assert "not ready" in refused.stderr
        node.orchestrator.hsm.fire("fault")
        reset = lupin("reset")
        assert (reset.returncode, reset.stdout.strip()) == (0, "ready")
        assert node.orchestrator.hsm.state == "READY"
    finally:
        os.close(lock)
