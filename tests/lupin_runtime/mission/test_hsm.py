"""The state machine's specification, and that the code fires only declared triggers."""

from __future__ import annotations

import ast
import subprocess
import sys
import typing
from pathlib import Path

import pytest

import lupin_runtime.mission
from lupin_runtime.mission.hsm import MissionHsm
from lupin_runtime.mission.hsm_spec import BUSY, Trigger, build_hsm_spec

PACKAGE = Path(lupin_runtime.mission.__file__).parent
VISIT_LEAVES = ("NAVIGATING", "SCANNING", "PUBLISHING")

# (trigger, leaf state) -> possible destinations
CONTRACT = {
    ("deps_up", "BOOT"): {"READY"},
    ("start_mission", "READY"): {"PREPARE"},
    ("localized", "PREPARE.LOCALIZING"): {"EXPLORING", "INSPECTING"},
    ("tags_discovered", "EXPLORING"): {"MONITORING"},
    ("no_frontiers", "EXPLORING"): {"MONITORING", "RETURNING"},
    ("returned", "RETURNING"): {"DONE"},
    ("resume_inspection", "RETURNING"): {"INSPECTING"},
    ("resume_monitoring", "RETURNING"): {"MONITORING"},
    ("resume_exploration", "RETURNING"): {"EXPLORING"},
    ("reset_for_next", "DONE"): {"READY"},
    ("recover", "FAULT"): {"READY"},
    ("abort_to_return", "PREPARE.LOCALIZING"): {"RETURNING"},
    ("abort_to_return", "EXPLORING"): {"RETURNING"},
    **{("abort_to_return", f"{f}.{leaf}"): {"RETURNING"} for f in ("INSPECTING", "MONITORING") for leaf in VISIT_LEAVES},
    **{
        (trigger, f"{f}.{source}"): {f"{f}.{dest}"}
        for f in ("INSPECTING", "MONITORING")
        for trigger, source, dest in (
            ("nav_succeeded", "NAVIGATING", "SCANNING"),
            ("nav_unreachable", "NAVIGATING", "PUBLISHING"),
            ("scan_done", "SCANNING", "PUBLISHING"),
            ("next_tag", "PUBLISHING", "NAVIGATING"),
        )
    },
    **{("inspection_complete", f"{f}.PUBLISHING"): {"RETURNING"} for f in ("INSPECTING", "MONITORING")},
}


def test_transitions_match_contract() -> None:
    spec = build_hsm_spec()
    declared = {
        (trigger, leaf): {t.dest for t in spec.destinations(trigger, leaf)}
        for trigger in typing.get_args(Trigger)
        for leaf in spec.leaves()
        if spec.destinations(trigger, leaf)
    }
    faults = {key: declared.pop(key) for key in list(declared) if key[0] == "fault"}
    assert declared == CONTRACT
    assert {leaf for _, leaf in faults} == set(spec.leaves()) - {"DONE", "FAULT"}


def test_states_match_contract() -> None:
    spec = build_hsm_spec()
    assert [state.name for state in spec.states] == [
        *("BOOT", "READY", "PREPARE", "EXPLORING", "INSPECTING", "MONITORING", "RETURNING", "DONE", "FAULT")
    ]
    assert spec.initial == "BOOT"
    assert spec.leaf_of("PREPARE") == "PREPARE.LOCALIZING"
    assert spec.leaf_of("INSPECTING") == "INSPECTING.NAVIGATING"
    assert {"PREPARE", "EXPLORING", "INSPECTING", "MONITORING", "RETURNING"} == BUSY


def _fired_in_code() -> set[str]:
    fired: set[str] = set()
    for file in PACKAGE.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "fire":
                constants = (leaf for leaf in ast.walk(node) if isinstance(leaf, ast.Constant))
                fired |= {leaf.value for leaf in constants if isinstance(leaf.value, str)}
    return fired


def test_fired_triggers_match_declared_ones() -> None:
    spec = build_hsm_spec()
    declared = {t.trigger for t in spec.transitions}
    assert declared == set(typing.get_args(Trigger))
    fired = _fired_in_code()
    assert fired <= declared
    fired_through_variables = {"resume_inspection", "resume_monitoring", "resume_exploration", "nav_unreachable", "scan_done"}
    assert declared - fired <= fired_through_variables


@pytest.mark.parametrize("trigger", typing.get_args(Trigger))
def test_undeclared_trigger_is_ignored(trigger: Trigger) -> None:
    guards = {name: (lambda: True) for name in ("is_exploration", "is_inspection", "has_discovered_tags", "has_no_tags")}
    hsm = MissionHsm(guards)
    assert hsm.fire(trigger) == (trigger in ("deps_up", "fault"))
    assert bool(hsm.ignored) == (trigger not in ("deps_up", "fault"))


def test_trigger_fired_in_transition_is_queued() -> None:
    seen: list[tuple[str, str]] = []

    def on_change(source: str, dest: str) -> None:
        seen.append((source, dest))
        if dest == "READY":
            hsm.fire("start_mission")
            assert hsm.state == "READY"

    guards = {name: (lambda: True) for name in ("is_exploration", "is_inspection", "has_discovered_tags", "has_no_tags")}
    hsm = MissionHsm(guards, on_change)
    hsm.fire("deps_up")
    assert seen == [("BOOT", "READY"), ("READY", "PREPARE.LOCALIZING")]


def test_declared_trigger_changes_nothing_if_guards_reject() -> None:
    guards = {name: (lambda: True) for name in ("is_exploration", "is_inspection")}
    guards |= {name: (lambda: False) for name in ("has_discovered_tags", "has_no_tags")}
    hsm = MissionHsm(guards)
    hsm.fire("deps_up")
    hsm.fire("start_mission")
    hsm.fire("localized")
    assert hsm.fire("no_frontiers")
    assert (hsm.state, hsm.ignored) == ("EXPLORING", [])


def test_specification_imports_neither_ros_nor_transitions() -> None:
    code = (
        "import sys; from lupin_runtime.mission.hsm_spec import build_hsm_spec; build_hsm_spec();"
        "sys.exit(any(m in sys.modules for m in ('rclpy', 'transitions', 'numpy')))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=PACKAGE.parents[1], timeout=60).returncode == 0
