"""A path that somebody else chose leads to a file of bounded size, or to an error that says what it leads to."""

from __future__ import annotations

import codecs
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.bounded_file import (
    NotUtf8,
    decode_text,
    expand_home,
    is_file,
    is_folder,
    open_regular,
    open_text,
    read_bounded,
    read_bounded_text,
)


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


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r\0")))
def test_byte_order_mark_is_no_part_of_the_text(text: str) -> None:
    assert decode_text(codecs.BOM_UTF8 + text.encode(), "x") == text


# Unicode 16, 23.8: the marks by which a text shows its encoding; without one, ASCII in UTF-16 shows by its zero bytes.
@pytest.mark.parametrize(
    ("encoding", "found"),
    [("utf-16", "UTF-16"), ("utf-16-le", "UTF-16"), ("utf-16-be", "UTF-16"), ("utf-32", "UTF-32")],
)
@pytest.mark.parametrize("errors", ["strict", "replace", "surrogateescape"])
def test_other_encoding_is_named(encoding: str, found: str, errors: str, tmp_path: Path) -> None:
    path = tmp_path / "text"
    for mark in ("", "\ufeff") if encoding.endswith("e") else ("",):
        path.write_bytes(f"{mark}name = 1\n".encode(encoding))
        with pytest.raises(NotUtf8, match=f"is {found}; save it as UTF-8"):
            read_bounded_text(path, errors=errors)
        with pytest.raises(NotUtf8, match=f"is {found}; save it as UTF-8"):
            open_text(path)


def test_bytes_of_an_older_encoding_are_located() -> None:
    with pytest.raises(NotUtf8, match="line 2, column 4, byte 0xe9") as refused:
        decode_text(b"a\nb c\xe9", "x")
    assert (refused.value.line, refused.value.column) == (2, 4)


def test_text_is_read_line_by_line_without_its_mark(tmp_path: Path) -> None:
    (tmp_path / "text").write_bytes(codecs.BOM_UTF8 + b"a\r\nb\xff\n")
    with open_text(tmp_path / "text") as lines:
        assert list(lines) == ["a\n", "b\ufffd\n"]
