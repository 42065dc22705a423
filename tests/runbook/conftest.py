"""A folder for playbooks and journals, and this machine as robot and laptop: what is played here really happens, in there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_cli.runbook import Playbook, load
from lupin_cli.target.local import LocalTarget


@pytest.fixture
def targets() -> dict[str, LocalTarget]:
    return {"robot": LocalTarget("robot"), "laptop": LocalTarget("laptop")}


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Writes a playbook and gives its file; the two lines that every one begins with are added."""

    def write(body: str, name: str = "book") -> Path:
        path = tmp_path / f"{name}.yaml"
        path.write_text(f"name: {name}\ndescription: A test.\n{body}")
        return path

    return write


@pytest.fixture
def loaded(written: Callable[..., Path]) -> Callable[..., Playbook]:
    def read(body: str, name: str = "book") -> Playbook:
        return load(written(body, name))

    return read
