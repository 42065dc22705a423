"""Which checks exist, which ones plug-ins add, and which are selected."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks import Check
from lupin_cli.checks.table import UnknownCheck, built_in, plugged_in, select
from lupin_cli.doctor.gathering import needed_facts


@dataclass
class EntryPoint:
    name: str
    loaded: Any
    value: str = "package.module:CHECKS"

    def load(self) -> Any:
        if isinstance(self.loaded, Exception):
            raise self.loaded
        return self.loaded


ONE, TWO, THREE = (Check(name, lambda _e: ()) for name in ("dds.server", "dds.shell", "clock"))


def test_plugin_adds_one_check_or_several() -> None:
    checks, plugin_errors = plugged_in([EntryPoint("one", ONE), EntryPoint("many", [TWO, THREE])])  # type: ignore[list-item]
    assert checks == (ONE, TWO, THREE)
    assert plugin_errors == ()


@pytest.mark.parametrize("loaded", [ImportError("no module named x"), 7, ["a word"]])
def test_broken_plugin_is_named_and_others_load(loaded: ImportError | int | list[str]) -> None:
    checks, (gap,) = plugged_in([EntryPoint("theirs", loaded), EntryPoint("one", ONE)])  # type: ignore[list-item]
    assert checks == (ONE,)
    assert str(gap).startswith("plug-in theirs (package.module:CHECKS): ")


def test_only_and_skip_accept_names_and_patterns() -> None:
    every = (ONE, TWO, THREE)
    assert select(every) == every
    assert select(every, only=["dds.*"]) == (ONE, TWO)
    assert select(every, only=["dds.*"], skip=["dds.shell"]) == (ONE,)
    assert select(every, skip=["clock"]) == (ONE, TWO)


def test_unmatched_pattern_suggests_the_nearest_check() -> None:
    with pytest.raises(UnknownCheck, match=r"did you mean dds\.server"):
        select((ONE, TWO), only=["dds.servr"])


def test_built_in_check_and_fact_names_are_unique() -> None:
    checks = built_in()
    names = [check.name for check in checks]
    assert len(set(names)) == len(names)
    for machine in ("laptop", "robot"):
        needed_facts(checks, machine)


def test_installed_package_adds_checks_by_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "their_checks.py").write_text(
        "from lupin_cli.checks import Check\nCHECKS = [Check('theirs', lambda evidence: ())]\n"
    )
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lupin.checks]\ngood = their_checks:CHECKS\nbad = their_checks:NOTHING\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    checks, plugin_errors = plugged_in()
    assert "theirs" in [check.name for check in checks]
    assert any(str(gap).startswith("plug-in bad (their_checks:NOTHING): AttributeError") for gap in plugin_errors)
