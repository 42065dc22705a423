"""The shipped playbooks are valid, and every name in them exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.package_data import shipped_folder
from lupin_cli.playbook import list_shipped, load
from lupin_cli.playbook.binding import Binding

EXPECTED = {
    "deploy-robot", "remove-robot", "deploy-laptop", "remove-laptop", "sync-clock", "install-clock-sync", "recover-discovery",
    "single-home", "demo-wired", "demo-router", "demo-access-point", "sweep", "heal", "pin-wifi",
}  # fmt: skip


def test_expected_playbooks_are_shipped() -> None:
    assert {path.stem for path in list_shipped()} >= EXPECTED


@pytest.mark.parametrize("path", list_shipped(), ids=lambda path: path.stem)
def test_shipped_playbook_is_valid(path: Path) -> None:
    book = load(path)
    assert book.description.endswith(".") and len(book.description) < 128
    names = [step.name for step in book.steps]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("path", list_shipped(), ids=lambda path: path.stem)
def test_shipped_playbook_defaults_are_valid_arguments(path: Path) -> None:
    book = load(path)
    samples = {"text": "some", "secret": "long enough", "address": "10.0.0.7", "list": ["source ~/setup.bash"]}
    given = {variable.name: samples[variable.type] for variable in book.variables if not variable.has_default}
    Binding(book, given, {"robot": LocalTarget("robot"), "laptop": LocalTarget()})


def test_playbooks_named_by_findings_are_shipped() -> None:
    checks = shipped_folder("playbooks").parent / "lupin_cli" / "checks"
    named = {name for path in checks.glob("*.py") for name in re.findall(r'playbook="([^"]+)"', path.read_text())}
    assert named and named <= {path.stem for path in list_shipped()}
