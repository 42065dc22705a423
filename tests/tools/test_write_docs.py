"""Generated pages and tables equal what the code says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tools import write_docs
from tools.write_docs import insert_table

PAGE = "# Page\n\n<!-- table of x: begin -->\n\n| old |\n\n<!-- table of x: end -->\n\nAfter.\n"


def test_generated_pages_match_the_code() -> None:
    command = [sys.executable, "-m", "tools.write_docs", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_table_replaces_only_what_is_between_its_markers() -> None:
    page = insert_table(PAGE, "x", "| new |")
    assert page == PAGE.replace("| old |", "| new |")
    assert insert_table(page, "x", "| new |") == page


@pytest.mark.parametrize("page", ["# Page\n", PAGE + PAGE, PAGE.replace("end", "END")])
def test_page_without_one_pair_of_markers_is_refused(page: str) -> None:
    with pytest.raises(ValueError, match="expected <!-- table of x: begin --> and then"):
        insert_table(page, "x", "| new |")


def test_check_names_a_page_that_was_edited_by_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for page in (ROOT / "docs").glob("*.md"):
        (tmp_path / page.name).write_text(page.read_text(encoding="utf-8"), encoding="utf-8")
    edited = tmp_path / "regressions.md"
    edited.write_text(edited.read_text(encoding="utf-8").replace("| 1 | The e-stop", "| 1 | An e-stop"), encoding="utf-8")
    monkeypatch.setattr(write_docs, "DOCS", tmp_path)
    monkeypatch.setattr(sys, "argv", ["write_docs", "--check"])
    assert write_docs.main() == 1
    assert capsys.readouterr().out == "regressions.md differs from the code; write it with: python -m tools.write_docs\n"
    monkeypatch.setattr(sys, "argv", ["write_docs"])
    assert write_docs.main() == 0
    assert edited.read_text(encoding="utf-8") == (ROOT / "docs/regressions.md").read_text(encoding="utf-8")
