"""Writing the archive: completely and readable only by its owner, or not at all."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_cli.bundle.archive import CannotWrite, check_writable, write


def test_written_archive_is_readable_by_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "b.tar.gz"
    before = os.umask(0)
    try:
        write(path, b"x" * 100_000, force=False)
    finally:
        os.umask(before)
    assert path.read_bytes() == b"x" * 100_000
    assert path.stat().st_mode & 0o777 == 0o600
    assert list(tmp_path.iterdir()) == [path]


def test_existing_file_is_overwritten_only_with_force(tmp_path: Path) -> None:
    path = tmp_path / "b.tar.gz"
    path.write_bytes(b"mine")
    with pytest.raises(CannotWrite, match="--force"):
        write(path, b"new", force=False)
    assert path.read_bytes() == b"mine"
    write(path, b"new", force=True)
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_full_disk_keeps_old_archive_and_no_partial_file(tmp_path: Path) -> None:
    path = tmp_path / "b.tar.gz"
    path.write_bytes(b"old")
    # A limit on the file size simulates a full disk: the write fails after 4096 bytes.
    code = (
        "import resource, sys; from pathlib import Path; from lupin_cli.bundle.archive import CannotWrite, write\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "try:\n    write(Path(sys.argv[1]), b'x' * 100_000, force=True)\nexcept CannotWrite as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60, check=True)
    assert "cannot be written: File too large" in done.stdout
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("place", "words"),
    [("no/b.tar.gz", "there is no folder"), (".", "is a folder"), ("existing", "with --force"), ("link", "with --force")],
)
def test_unwritable_path_is_reported_before_collecting(tmp_path: Path, place: str, words: str) -> None:
    (tmp_path / "existing").touch()
    (tmp_path / "link").symlink_to("/nowhere")
    with pytest.raises(CannotWrite, match=words):
        check_writable(tmp_path / place, force=False)
