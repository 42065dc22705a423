"""The extra `lupin[foxglove]`: its pin in pyproject.toml, and the advice if it is missing."""

from __future__ import annotations

import importlib.metadata
import sys
from pathlib import Path

import pytest
import tomllib

from lupin_runtime.foxglove.extra import install_advice, is_installed

EXTRAS = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def test_advice_names_the_pinned_package_of_the_extra() -> None:
    (pinned,) = EXTRAS["foxglove"]
    others = ['foxglove-websocket>=1; extra == "dev"', "foxglove-sdk", "numpy>=1.26"]
    advice = install_advice([*others, f'{pinned}; extra == "foxglove"'])
    assert advice.endswith(f"Install it with: {sys.executable} -m pip install '{pinned}'")
    assert "MIT" in advice and "54 MB" in advice


def test_advice_without_metadata_still_names_the_package() -> None:
    assert install_advice([]).endswith("-m pip install 'foxglove-sdk'")


def test_tests_use_the_version_that_the_extra_pins() -> None:
    assert "lupin[foxglove]" in EXTRAS["dev"]
    (pinned,) = EXTRAS["foxglove"]
    assert pinned == f"foxglove-sdk=={importlib.metadata.version('foxglove-sdk')}"
    assert is_installed()


def test_missing_package_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", missing)
    assert not is_installed()
