"""Which checks there are, and which are run."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import lupin_cli.checks
from lupin_cli.checks import Check
from lupin_cli.checks.consequences import NOBODY_ANSWERS, SEEN_OVER_THE_GRAPH
from lupin_cli.checks.table import UnknownCheck, built_in, plugged_in, select
from lupin_cli.diagnosis import facts_of


@dataclass
class EntryPoint:
    name: str
    loaded: Any
    value: str = "package.module:CHECKS"

    def load(self) -> Any:
        if isinstance(self.loaded, Exception):
            raise self.loaded
        return self.loaded


ONE, TWO, THREE = (Check(name, lambda e: ()) for name in ("dds.server", "dds.shell", "clock"))


def test_plug_ins_add_one_check_or_several() -> None:
    checks, broken = plugged_in([EntryPoint("one", ONE), EntryPoint("many", [TWO, THREE])])
    assert checks == (ONE, TWO, THREE)
    assert broken == ()


@pytest.mark.parametrize("loaded", [ImportError("no module named x"), 7, ["a word"]])
def test_a_broken_plug_in_is_named_and_stops_nothing(loaded) -> None:
    checks, (line,) = plugged_in([EntryPoint("theirs", loaded), EntryPoint("one", ONE)])
    assert checks == (ONE,)
    assert line.startswith("plug-in theirs (package.module:CHECKS): ")


def test_only_and_skip_take_names_and_patterns() -> None:
    every = (ONE, TWO, THREE)
    assert select(every) == every
    assert select(every, only=["dds.*"]) == (ONE, TWO)
    assert select(every, only=["dds.*"], skip=["dds.shell"]) == (ONE,)
    assert select(every, skip=["clock"]) == (ONE, TWO)


def test_a_pattern_without_a_check_names_the_nearest_one() -> None:
    with pytest.raises(UnknownCheck, match=r"did you mean dds\.server"):
        select((ONE, TWO), only=["dds.servr"])


def test_names_of_the_built_in_checks_are_unique_and_so_are_their_facts() -> None:
    checks = built_in()
    names = [check.name for check in checks]
    assert len(set(names)) == len(names)
    for machine in ("laptop", "robot"):
        facts_of(checks, machine)


def test_the_manual_names_every_check_and_every_finding_of_the_link() -> None:
    manual = (Path(__file__).parents[2] / "docs" / "doctor.md").read_text()
    folder = Path(lupin_cli.checks.__file__).parent
    for module in ("link", "discovery", "homing", "environment", "profiles", "leftovers", "ports"):
        tree = ast.parse((folder / f"{module}.py").read_text())
        words = [node.value for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "id"]
        for name in [word.value for word in words if isinstance(word, ast.Constant)]:
            short = re.sub(r"^(profile|discovery-server)", "", name)
            assert f"`{name}`" in manual or f"`{short}`" in manual, name
    for check in built_in():
        if check.name.startswith(("link.", "discovery.", "dds.")) or check.name == "ports":
            assert f"`{check.name}`" in manual


def test_an_installed_package_adds_its_checks_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "their_checks.py").write_text(
        "from lupin_cli.checks import Check\nCHECKS = [Check('theirs', lambda evidence: ())]\n"
    )
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lupin.checks]\ngood = their_checks:CHECKS\nbad = their_checks:NOTHING\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    checks, broken = plugged_in()
    assert "theirs" in [check.name for check in checks]
    assert any(line.startswith("plug-in bad (their_checks:NOTHING): AttributeError") for line in broken)


def test_what_a_broken_graph_explains_is_a_finding_that_exists() -> None:
    ids = set()
    for path in Path(lupin_cli.checks.__file__).parent.glob("*.py"):
        words = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.keyword) and node.arg == "id"]
        ids |= {word.value.value for word in words if isinstance(word.value, ast.Constant)}
    assert ids >= SEEN_OVER_THE_GRAPH | NOBODY_ANSWERS
