"""Sources of a bundle: their output becomes an item of the archive, or an omission with its reason."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.bundle import sources
from lupin_cli.bundle.items import ABSENT, UNREACHABLE, UNREADABLE, BundleItem, Omission
from lupin_cli.bundle.sources import ItemSource, parse_source, read_sources
from lupin_cli.connection import Output, Unreachable
from lupin_cli.connection.base import Script
from lupin_cli.connection.local import LocalTarget

SOURCE = ItemSource("x.log", "log of x", "", root=True)


def parsed(
    stdout: str, status: int | None = 0, stderr: str = "", *, refused: str = "", truncated: bool = False
) -> BundleItem | Omission:
    return parse_source(SOURCE, Output(status, stdout, stderr, truncated=truncated), "robots/a", "mirte", refused)


def lines(first: int, last: int) -> str:
    return "".join(f"2026-11-21T10:{number // 60:02}:{number % 60:02} line\n" for number in range(first, last))


def test_short_journal_is_complete_and_in_order() -> None:
    found = parsed(f"@@ last\n{lines(0, 50)}\n@@ first\n{lines(0, 50)}")
    assert isinstance(found, BundleItem)
    assert (found.path, found.content.decode(), found.remark) == ("robots/a/x.log", lines(0, 50), "")


def test_overlapping_ends_of_journal_are_merged() -> None:
    found = parsed(f"@@ last\n{lines(30, 80)}\n@@ first\n{lines(0, 50)}")
    assert isinstance(found, BundleItem)
    assert (found.content.decode(), found.remark) == (lines(0, 80), "")


def test_long_journal_keeps_both_ends_and_names_gap() -> None:
    found = parsed(f"@@ last\n{lines(500, 600)}\n@@ first\n{lines(0, 50)}")
    assert isinstance(found, BundleItem)
    text = found.content.decode()
    assert text.startswith(lines(0, 50)) and text.endswith(lines(500, 600))
    assert "left out here" in text and "left out" in found.remark


def test_incomplete_first_line_of_tail_is_dropped() -> None:
    tail = "cret=halved\n" + "x" * sources.TAIL_BYTES + "\nend\n"
    found = parsed(f"@@ last\n{tail}\n@@ first\nthe start\n")
    assert isinstance(found, BundleItem)
    assert b"halved" not in found.content
    assert found.content.endswith(b"end\n")


@pytest.mark.parametrize(
    ("output", "kind", "reason"),
    [
        ({"stdout": "", "status": sources.NOT_FOUND}, ABSENT, "this machine has none"),
        ({"stdout": "@@ last\n\n@@ first\n"}, ABSENT, "it is empty"),
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
def test_empty_output_becomes_omission_with_reason(output: dict[str, Any], kind: str, reason: str) -> None:
    found = parsed(**output)
    assert isinstance(found, Omission)
    assert found.kind == kind
    assert reason in found.reason


def test_output_until_timeout_is_kept_with_remark() -> None:
    found = parsed("half of it\n", None, "no end within 15 s")
    assert isinstance(found, BundleItem)
    assert (found.content, found.remark) == (b"half of it\n", "no end within 15 s")


class SudoRefused(LocalTarget):
    """This machine, with a user that sudo refuses."""

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        outputs = super().batch([script for script in scripts if not script.root], timeout_s)
        return outputs | {each.name: Output(None, "", "root refused: a password is required") for each in scripts if each.root}


def test_source_refused_by_sudo_is_read_as_user() -> None:
    three = [
        ItemSource("a", "", "echo mine", root=True),
        ItemSource("b", "", "exit 1", root=True),
        ItemSource("c", "", "echo all"),
    ]
    a, b, c = read_sources(SudoRefused(), three, "laptop")
    assert isinstance(a, BundleItem) and a.content == b"mine\n" and "a password is required" in a.remark
    assert isinstance(b, Omission) and b.kind == UNREADABLE
    assert isinstance(c, BundleItem) and c.remark == ""


class UnreachableTarget(LocalTarget):
    """A machine that can no longer be reached."""

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:  # noqa: ARG002 -- Target's signature
        raise Unreachable("the link was cut", "lost")


def test_unreachable_machine_gives_omission_per_source() -> None:
    found = list(read_sources(UnreachableTarget(), sources.sources_of(sources.ROBOT), "robots/a"))
    assert len(found) == len(sources.sources_of(sources.ROBOT))
    assert {(each.kind, each.reason) for each in found if isinstance(each, Omission)} == {(UNREACHABLE, "the link was cut")}


@pytest.mark.parametrize("source", sources.SOURCES, ids=lambda source: source.path)
def test_every_script_is_valid_sh(source: ItemSource) -> None:
    script = sources.script_of(source, 3600.0)
    done = subprocess.run(["/bin/sh", "-n"], input=script, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_files_are_concatenated_and_each_is_truncated(tmp_path: Path) -> None:
    (tmp_path / "a.conf").write_text("first\n")
    (tmp_path / "b.conf").write_text("x" * 2000 + "end\n")
    source = sources.files("x", "", f"{tmp_path}/*.conf", f"{tmp_path}/none/*", limit=1000)
    (found,) = read_sources(LocalTarget(), [source], "laptop")
    assert isinstance(found, BundleItem)
    text = found.content.decode()
    assert text.startswith(f"@@ file {tmp_path}/a.conf\nfirst\n\n@@ file {tmp_path}/b.conf\nxxx")
    assert "the rest of" in text and "end" not in text.splitlines()[-2]
    (none,) = read_sources(LocalTarget(), [sources.files("x", "", f"{tmp_path}/none/*")], "laptop")
    assert isinstance(none, Omission) and none.kind == ABSENT
