"""The version of the page's build."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_runtime.console import page_files


def test_version_follows_the_content_of_the_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(page_files, "_PAGE", tmp_path)
    assert page_files.page_version() == ""
    (tmp_path / "index.html").write_text("one")
    first = page_files.page_version()
    (tmp_path / "index.html").write_text("another")
    assert first and page_files.page_version() not in ("", first)
