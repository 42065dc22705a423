"""The archive on the disk: whole and its owner's alone, or not at all."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_cli.bundle.archive import CannotWrite, check_place, write


def test_it_is_there_whole_and_readable_by_its_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "b.tar.gz"
    before = os.umask(0)
    try:
        write(path, b"x" * 100_000, force=False)
    finally:
        os.umask(before)
    assert path.read_bytes() == b"x" * 100_000
    assert path.stat().st_mode & 0o777 == 0o600
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_came_in_between_is_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / "b.tar.gz"
    path.write_bytes(b"mine")
    with pytest.raises(CannotWrite, match="--force"):
        write(path, b"new", force=False)
    assert path.read_bytes() == b"mine"
    write(path, b"new", force=True)
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_disk_that_is_full_leaves_no_half_of_it_and_the_old_one_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "b.tar.gz"
    path.write_bytes(b"old")
    # The limit of a file's size stands in for the disk's end: the write fails after its first 4096 bytes.
    code = (
        "import resource, sys; from pathlib import Path; from lupin_cli.bundle.archive import CannotWrite, write\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "try:\n    write(Path(sys.argv[1]), b'x' * 100_000, force=True)\nexcept CannotWrite as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60, check=True)
    assert "can't be written: File too large" in done.stdout
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("place", "words"),
    [("no/b.tar.gz", "there is no folder"), (".", "is a folder"), ("there", "with --force"), ("link", "with --force")],
)
def test_a_place_that_cannot_be_is_told_beforehand(tmp_path: Path, place: str, words: str) -> None:
    (tmp_path / "there").touch()
    (tmp_path / "link").symlink_to("/nowhere")
    with pytest.raises(CannotWrite, match=words):
        check_place(tmp_path / place, force=False)
