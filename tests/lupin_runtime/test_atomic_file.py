"""Files that are replaced in one step."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from lupin_runtime.atomic_file import write_atomically


@pytest.mark.parametrize(("content", "mode"), [("text with ü", 0o644), (b"\x00\xff", 0o600)], ids=["text", "bytes"])
def test_write_atomically_sets_content_and_mode(tmp_path: Path, content: str | bytes, mode: int) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    path.chmod(0o640)
    write_atomically(path, content, mode=mode)
    assert path.read_bytes() == (content.encode() if isinstance(content, str) else content)
    assert path.stat().st_mode & 0o777 == mode


@pytest.mark.parametrize(("folder", "mode"), [(0o700, 0o600), (0o755, 0o640), (0o710, 0o640)])
def test_file_in_a_private_folder_is_private(tmp_path: Path, folder: int, mode: int) -> None:
    tmp_path.chmod(folder)
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "file", "text")
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == mode


def test_failed_write_keeps_the_old_file_and_no_temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full_disk(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "map.yaml"
    write_atomically(path, b"old", sync=True)
    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(OSError, match="space"):
        write_atomically(path, b"new", sync=True)
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["map.yaml"]
