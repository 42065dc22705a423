"""chrony's directives are found and changed in the files that chronyd reads, wherever they are, and nowhere else."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lupin_cli.operations import chrony_directive, chrony_folder
from lupin_cli.operations.chrony_directive import ChronyDirective
from lupin_cli.operations.chrony_folder import ChronyFolder
from tests.support.operation_cycle import apply_and_undo, examine, report

if TYPE_CHECKING:
    from lupin_cli.connection.local import LocalTarget

MAKESTEP = ChronyDirective(commented="makestep")
# Configurations: files by name below ETC, the files in which makestep is in force, and the folder that chronyd reads.
CONFIGURATIONS: dict[str, tuple[dict[str, str], list[str], str]] = {
    "capitals": ({"chrony.conf": "Pool ntp.example\nMakeStep 1 3\n"}, ["chrony.conf"], ""),
    "an included file": (
        {"chrony.conf": "INCLUDE ETC/more/*.conf\n", "more/site.conf": "makestep 1 3\n"},
        ["more/site.conf"],
        "",
    ),
    "a folder that nobody reads": ({"chrony.conf": "pool ntp.example\n", "conf.d/site.conf": "makestep 1 3\n"}, [], ""),
    "another folder": (
        {"chrony.conf": "confdir ETC/none.d ETC/local.d/\n", "local.d/a.conf": "\tmakestep 1 3"},
        ["local.d/a.conf"],
        "local.d",
    ),
    "every place at once": (
        {
            "chrony.conf": "makestep 1 3\r\nConfDir ETC/conf.d ETC/other.d\r\nsourcedir ETC/sources.d\r\n MAKESTEP 2 3\r\n",
            "conf.d/a.conf": "include ETC/deep\nlocal stratum 10\n",
            "conf.d/b.conf": "# makestep 1 3\n! makestep\n",
            "other.d/a.conf": "makestep 9 9\n",
            "deep": "makestep 1 3\nmakestep 1 3\nmakestepx\n",
            "sources.d/a.sources": "makestep 1 3\n",
        },
        ["chrony.conf", "deep"],
        "conf.d",
    ),
    "no configuration": ({}, [], ""),
}
_BY_NAME = pytest.mark.parametrize("name", CONFIGURATIONS)


@pytest.fixture
def etc(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    if os.getuid() != 0:
        pytest.skip("needs root: chrony's configuration belongs to root")
    for file, text in CONFIGURATIONS[name][0].items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text.replace("ETC", str(tmp_path)), newline="")
        (tmp_path / file).chmod(0o640)
    for module in (chrony_directive, chrony_folder):
        reader = module.READER.replace("pidof -s chronyd", ":").replace("/etc/chrony", str(tmp_path))
        monkeypatch.setattr(module, "READER", reader.replace("/etc/chrony.conf", ""))
    return tmp_path


@_BY_NAME
def test_makestep_is_commented_out_where_it_is_in_force(name: str, etc: Path, target: LocalTarget) -> None:
    files, changed, _ = CONFIGURATIONS[name]
    before = {file: (etc / file).read_bytes() for file in files}
    difference = examine(MAKESTEP, target)
    assert (difference.summary if difference else "") == (
        f"comment out makestep in {', '.join(str(etc / file) for file in changed)}" if changed else ""
    )
    if difference is None:
        return
    MAKESTEP.change(target, difference)
    assert examine(MAKESTEP, target) is None
    assert [file for file in files if (etc / file).read_bytes() != before[file]] == changed
    assert all((etc / file).stat().st_mode & 0o777 == 0o640 for file in files)
    MAKESTEP.undo(target, difference.before)
    apply_and_undo(MAKESTEP, target)
    assert {file: (etc / file).read_bytes() for file in files} == before


@_BY_NAME
def test_folder_is_one_that_chronyd_reads(name: str, etc: Path, target: LocalTarget) -> None:
    files, _, folder = CONFIGURATIONS[name]
    found = report(ChronyFolder(), target)
    main = str(etc / "chrony.conf") if files else "/etc/chrony/chrony.conf"
    assert found == {"folder": str(etc / folder) if folder else "", "main": main}


@pytest.mark.parametrize("word", ["", "Makestep", "make step", "a|b", "x;rm"])
def test_what_is_no_directive_is_refused(word: str) -> None:
    with pytest.raises(ValueError, match="a word in lower case"):
        ChronyDirective(commented=word)
