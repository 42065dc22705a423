"""What a machine's answers become: files of the archive, or a line that says why there is none."""

from __future__ import annotations

import subprocess

import pytest

from lupin_cli.bundle import asking, sources
from lupin_cli.bundle.pieces import ABSENT, UNREACHABLE, UNREADABLE, LeftOut, Piece
from lupin_cli.bundle.sources import Source
from lupin_cli.target import Output, Unreachable
from lupin_cli.target.local import LocalTarget

SOURCE = Source("x.log", "what x said", "", root=True)


def read(
    stdout: str, status: int | None = 0, stderr: str = "", *, refused: str = "", truncated: bool = False
) -> Piece | LeftOut:
    return asking.read(SOURCE, Output(status, stdout, stderr, truncated=truncated), "robots/a", "mirte", refused)


def lines(first: int, last: int) -> str:
    return "".join(f"2026-11-21T10:{number // 60:02}:{number % 60:02} line\n" for number in range(first, last))


def test_a_journal_that_fits_is_whole_and_in_order() -> None:
    found = read(f"@@ last\n{lines(0, 50)}\n@@ first\n{lines(0, 50)}")
    assert isinstance(found, Piece)
    assert (found.path, found.content.decode(), found.remark) == ("robots/a/x.log", lines(0, 50), "")


def test_of_a_journal_whose_ends_overlap_nothing_stands_twice() -> None:
    found = read(f"@@ last\n{lines(30, 80)}\n@@ first\n{lines(0, 50)}")
    assert isinstance(found, Piece)
    assert (found.content.decode(), found.remark) == (lines(0, 80), "")


def test_of_a_long_journal_the_first_and_the_last_lines_are_there_and_the_gap_is_told() -> None:
    found = read(f"@@ last\n{lines(500, 600)}\n@@ first\n{lines(0, 50)}")
    assert isinstance(found, Piece)
    text = found.content.decode()
    assert text.startswith(lines(0, 50)) and text.endswith(lines(500, 600))
    assert "left out here" in text and "left out" in found.remark


def test_a_tail_that_begins_within_a_line_loses_that_line() -> None:
    tail = "cret=halved\n" + "x" * sources.TAIL_BYTES + "\nend\n"
    found = read(f"@@ last\n{tail}\n@@ first\nthe start\n")
    assert isinstance(found, Piece)
    assert b"halved" not in found.content
    assert found.content.endswith(b"end\n")


@pytest.mark.parametrize(
    ("said", "kind", "words"),
    [
        ({"stdout": "", "status": sources.ABSENT}, ABSENT, "none on this machine"),
        ({"stdout": "@@ last\n\n@@ first\n"}, ABSENT, "says nothing"),
        (
            {"stdout": "", "status": 1, "stderr": "a\ndmesg: Operation not permitted"},
            UNREADABLE,
            "dmesg: Operation not permitted",
        ),
        ({"stdout": "", "stderr": "No journal files were opened due to insufficient permissions."}, UNREADABLE, "permissions"),
        ({"stdout": "", "refused": "root refused: a password is required"}, UNREADABLE, "a password is required"),
        ({"stdout": "", "status": None, "stderr": "no end within 15 s"}, UNREADABLE, "no end within 15 s"),
    ],
)
def test_what_is_not_there_says_why(said: dict, kind: str, words: str) -> None:
    found = read(**said)
    assert isinstance(found, LeftOut)
    assert found.kind == kind
    assert words in found.reason


def test_what_was_cut_off_in_time_is_kept_and_says_so() -> None:
    found = read("half of it\n", None, "no end within 15 s")
    assert isinstance(found, Piece)
    assert (found.content, found.remark) == (b"half of it\n", "no end within 15 s")


class Refusing(LocalTarget):
    """This machine, as a user whom sudo refuses."""

    def batch(self, scripts, bound_s=10.0):
        asked = super().batch([script for script in scripts if not script.root], bound_s)
        return asked | {each.name: Output(None, "", "root refused: a password is required") for each in scripts if each.root}


def test_what_sudo_refuses_is_asked_for_as_the_user_who_may_be_let() -> None:
    asked = [Source("a", "", "echo mine", root=True), Source("b", "", "exit 1", root=True), Source("c", "", "echo all")]
    a, b, c = asking.ask(Refusing(), asked, "laptop")
    assert isinstance(a, Piece) and a.content == b"mine\n" and "a password is required" in a.remark
    assert isinstance(b, LeftOut) and b.kind == UNREADABLE
    assert isinstance(c, Piece) and c.remark == ""


class Gone(LocalTarget):
    """A machine that can't be asked any more."""

    def batch(self, scripts, bound_s=10.0):
        raise Unreachable("the link went", "lost")


def test_a_machine_that_went_away_is_a_line_for_each_source() -> None:
    found = list(asking.ask(Gone(), sources.of_machine(sources.ROBOT), "robots/a"))
    assert len(found) == len(sources.of_machine(sources.ROBOT))
    assert {(each.kind, each.reason) for each in found if isinstance(each, LeftOut)} == {(UNREACHABLE, "the link went")}


@pytest.mark.parametrize("source", sources.SOURCES, ids=lambda source: source.path)
def test_every_script_is_sh(source: Source) -> None:
    script = sources.script_of(source, 3600.0)
    done = subprocess.run(["/bin/sh", "-n"], input=script, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_files_are_read_one_behind_the_other_and_only_so_far(tmp_path) -> None:
    (tmp_path / "a.conf").write_text("first\n")
    (tmp_path / "b.conf").write_text("x" * 2000 + "end\n")
    source = sources.files("x", "", f"{tmp_path}/*.conf", f"{tmp_path}/none/*", limit=1000)
    (found,) = asking.ask(LocalTarget(), [source], "laptop")
    assert isinstance(found, Piece)
    text = found.content.decode()
    assert text.startswith(f"@@ file {tmp_path}/a.conf\nfirst\n\n@@ file {tmp_path}/b.conf\nxxx")
    assert "the rest of" in text and "end" not in text.splitlines()[-2]
    (none,) = asking.ask(LocalTarget(), [sources.files("x", "", f"{tmp_path}/none/*")], "laptop")
    assert isinstance(none, LeftOut) and none.kind == ABSENT
