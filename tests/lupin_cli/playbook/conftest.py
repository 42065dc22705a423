"""Playbooks in a temporary folder, and this machine as robot and laptop: steps really change files in that folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import Playbook, load


@pytest.fixture
def targets() -> dict[str, LocalTarget]:
    return {"robot": LocalTarget("robot"), "laptop": LocalTarget("laptop")}


@pytest.fixture
def write_playbook(tmp_path: Path) -> Callable[..., Path]:
    """A function that writes a playbook with this body and returns its file; it adds name and description."""

    def write(body: str, name: str = "book") -> Path:
        path = tmp_path / f"{name}.yaml"
        path.write_text(f"name: {name}\ndescription: A test.\n{body}")
        return path

    return write


@pytest.fixture
def load_playbook(write_playbook: Callable[..., Path]) -> Callable[..., Playbook]:
    def load_body(body: str, name: str = "book") -> Playbook:
        return load(write_playbook(body, name))

    return load_body
