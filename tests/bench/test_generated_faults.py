"""Laws of generated faults: what makes one can be undone, and both ends, every layer and every verb are drawn."""

from __future__ import annotations

import ast
import itertools
import shutil
import subprocess
import tempfile
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bench.faults
from bench import generated_cases, generated_faults, ground_truth
from bench.faults.fault import ENDS, HOST, INVENTORY, LAPTOP, LAYERS, LINK, PROFILE, ROBOT, SSH, Effect
from bench.generated_cases import Case, are_independent, draw_case, draw_cases
from lupin_cli.link.dds_setup import profile_xml
from lupin_sim.host.faults import FAULTS, parse_settings

SEEDS = st.integers(0, 2**32)
NUMBERS = st.integers(0, 10_000)
VERBS = {
    *("drop", "delay", "corrupt", "duplicate", "reorder", "stop", "kill", "unset", "edit", "unplug", "fill", "chmod"),
    *("rename", "shift", "limit"),
}


def first_cases(count: int = 300, seed: int = 0) -> list[Case]:
    return list(itertools.islice(draw_cases(seed), count))


@given(SEEDS, NUMBERS)
def test_case_depends_only_on_seed_and_number(seed: int, number: int) -> None:
    assert draw_case(seed, number) == draw_case(seed, number)


def test_draw_contains_every_verb_layer_and_machine() -> None:
    cases = first_cases()
    faults = [fault for case in cases for fault in case.faults]
    assert {fault.verb for fault in faults} == VERBS
    assert {fault.layer for fault in faults} == {*LAYERS, ""}
    assert {fault.machine for fault in faults} == {*ENDS, LINK, ""}
    assert {step.where for fault in faults for step in fault.steps} == {*ENDS, HOST}
    assert len({case.text for case in cases}) == len(cases)


def test_draw_has_harmless_cases_pairs_and_decoys() -> None:
    def kind(case: Case) -> str:
        return " ".join(sorted("harmless" if fault.effect is Effect.NOTHING else "fault" for fault in case.faults))

    counts = Counter(map(kind, first_cases()))
    assert counts.keys() == {"harmless", "fault", "fault fault", "fault harmless"}
    assert all(count >= 20 for count in counts.values()), counts


@pytest.mark.parametrize("layer", LAYERS)
def test_cases_of_one_layer_have_a_root_there(layer: str) -> None:
    assert all(layer in case.layers for case in itertools.islice(draw_cases(5, layer), 10))


@given(SEEDS, NUMBERS)
def test_two_faults_of_a_case_are_independent(seed: int, number: int) -> None:
    case = draw_case(seed, number)
    assert 1 <= len(case.faults) <= 2
    if len(case.faults) == 2:
        assert are_independent(*case.faults)
        assert sum(fault.restarts for fault in case.faults) <= 1
        assert case.faults[0].layer != case.faults[1].layer


@given(SEEDS, NUMBERS)
def test_fault_has_layer_and_machine_unless_harmless(seed: int, number: int) -> None:
    for fault in draw_case(seed, number).faults:
        assert bool(fault.layer) == bool(fault.machine) == (fault.effect is not Effect.NOTHING)
        assert fault.steps or fault.variables
        for step in fault.steps:
            # What is changed on one end lies at that end; only between both ends is the link.
            assert step.where == HOST or fault.machine in (step.where, "")
        assert not fault.variables or fault.machine in (LAPTOP, "")


@given(SEEDS, NUMBERS)
@settings(max_examples=60)
def test_every_script_is_valid_and_has_an_undo(seed: int, number: int) -> None:
    for step in draw_case(seed, number).steps:
        assert step.make and step.undo
        if step.where == HOST:
            name, *assignments = step.make.split()
            settings = parse_settings(name, assignments)
            assert settings.keys() <= FAULTS[name].settings.keys()
            undone, *of_link = step.undo.split()
            assert undone == name and FAULTS[name].undo is not None
            # A fault with a link is undone on its own link alone: the rig may have the same one on another.
            assert ("link" in FAULTS[name].settings) == bool(of_link) and parse_settings(
                name, of_link
            ).items() <= settings.items()
            continue
        assert step.make != step.undo
        for script in (step.make, step.undo):
            done = subprocess.run(["sh", "-n", "-c", script], capture_output=True, text=True, timeout=60, check=False)
            assert done.returncode == 0, f"{script}\n{done.stderr}"


def snapshot(folder: Path) -> dict[str, tuple[int, bytes]]:
    return {
        str(path.relative_to(folder)): (path.stat().st_mode, path.read_bytes() if path.is_file() else b"")
        for path in sorted(folder.rglob("*"))
    }


def operator_home(folder: Path) -> Path:
    for quoted, text in (
        (PROFILE, profile_xml("10.42.0.1")),
        ('"$HOME"/.config/lupin/ros-env.sh', "export ROS_DISCOVERY_SERVER=10.42.0.1:11811\n"),
        (INVENTORY, '[robots.greenhouse]\nuser = "mirte"\n'),
        (f"{SSH}/id_ed25519", "key\n"),
        (f"{SSH}/known_hosts", "10.42.0.1 ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIJ\n"),
    ):
        path = folder / quoted.replace('"$HOME"/', "")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


HOME_CASES = [
    case
    for case in first_cases(600, seed=1)
    if case.steps and all(step.where == LAPTOP and '"$HOME"' in step.make for step in case.steps)
]


def test_undo_restores_every_file_of_the_operator() -> None:
    assert {fault.verb for case in HOME_CASES for fault in case.faults} >= {"edit", "rename", "chmod"}
    for case in HOME_CASES:
        with tempfile.TemporaryDirectory() as name:
            home = operator_home(Path(name))
            before = snapshot(home)
            for step in case.steps:
                run_on_home(home, step.make)
            assert snapshot(home) != before, case.text
            for step in reversed(case.steps):
                run_on_home(home, step.undo)
            assert snapshot(home) == before, case.text


def run_on_home(home: Path, script: str) -> None:
    shell = shutil.which("sh")
    assert shell is not None
    env = {"HOME": str(home), "PATH": "/usr/bin:/bin"}
    subprocess.run([shell, "-ec", script], check=True, env=env, timeout=60)


def test_generator_and_observer_share_no_code_with_the_doctor() -> None:
    files = [Path(str(module.__file__)) for module in (generated_faults, generated_cases, ground_truth)]
    kinds = sorted(Path(str(bench.faults.__file__)).parent.glob("*.py"))
    assert len(kinds) > 5
    for file in (*files, *kinds):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        imported |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not [name for name in imported if name.startswith("lupin_")], file.name


def test_robot_scripts_never_match_their_own_shell() -> None:
    # pgrep -f and pkill -f would find the shell whose command line contains the pattern.
    for case in first_cases():
        for step in case.steps:
            if step.where == ROBOT and "pgrep -f" in step.make:
                assert "pgrep -f '[" in step.make
