"""Modules of other people's folders are not run: a person may be anywhere when a command starts processes."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from lupin_runtime.interpreter import PYTHON
from tests.support.paths import ROOT

PACKAGES = ("lupin_cli", "lupin_runtime", "lupin_sim")
INTRUDERS = ("numpy", "rclpy", "yaml", "typer", "json", "lupin_runtime")


@pytest.fixture
def hostile_folder(tmp_path: Path) -> Path:
    """A folder with modules that leave a mark when they are imported."""
    for name in INTRUDERS:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'mark')!r}, 'a').write({name!r})\n")
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        ("-m", "lupin_sim", "--help"),
        ("-m", "lupin_cli.app", "--version"),
        ("-m", "lupin_runtime.record.player", "--help"),
        ("-c", "import numpy, rclpy, yaml, typer"),
    ],
)
def test_current_folder_supplies_no_module(hostile_folder: Path, arguments: tuple[str, ...]) -> None:
    done = subprocess.run([*PYTHON, *arguments], cwd=hostile_folder, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert not (hostile_folder / "mark").exists()


def test_product_starts_modules_only_through_python() -> None:
    starts = re.compile(r"""sys\.executable, (\*|["']-)|python3? -[mcu] """)
    # The definition, this very command again, and what a person may type.
    allowed = re.compile(r"^PYTHON = |PYTHONSAFEPATH=1|sys\.orig_argv|`python -m|prog=|usage: |^    python -m")
    found = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in PACKAGES
        for path in (ROOT / folder).rglob("*")
        if path.suffix == ".py" and "host" not in path.parts  # the simulated computer's own programs
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if starts.search(line) and not allowed.search(line)
    ]
    assert found == []
