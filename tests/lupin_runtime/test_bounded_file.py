"""A path that somebody else chose leads to a file of bounded size, or to an error that says what it leads to."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lupin_runtime.bounded_file import expand_home, is_file, is_folder, open_regular, read_bounded, read_bounded_text


def test_named_pipe_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="named pipe"):
        open_regular(tmp_path / "pipe")


@pytest.mark.parametrize(("path", "found"), [("/dev/zero", "a device"), ("/", "a folder")])
def test_what_is_no_file_is_refused(path: str, found: str) -> None:
    with pytest.raises(OSError, match=found):
        read_bounded(path)


def test_file_beyond_the_limit_is_refused(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(b"12345")
    assert read_bounded(tmp_path / "large", 5) == b"12345"
    with pytest.raises(OSError, match="larger than 4 bytes"):
        read_bounded(tmp_path / "large", 4)


@pytest.mark.parametrize(("name", "words"), [("\0.pgm", "not a name of a file"), ("x" * 300, "too long")])
def test_impossible_names_are_errors_of_the_system(name: str, words: str) -> None:
    with pytest.raises(OSError, match=words):
        read_bounded(name)
    assert not is_file(name)
    assert not is_folder(name)


def test_home_of_an_unknown_user_stays_as_it_is_written() -> None:
    assert expand_home("~nouser-of-this-machine/x.yaml") == Path("~nouser-of-this-machine/x.yaml")
    assert expand_home("~/x.yaml") == Path.home() / "x.yaml"


def test_line_ends_are_line_feeds(tmp_path: Path) -> None:
    (tmp_path / "text").write_bytes(b"a\r\nb\rc\n")
    assert read_bounded_text(tmp_path / "text") == "a\nb\nc\n"
