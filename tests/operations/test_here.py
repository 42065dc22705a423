"""Operations on files, links, folders, commands and processes, on this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from cycle import there_and_back
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.operations import OperationError
from lupin_cli.operations.command import Command
from lupin_cli.operations.directory import Directory
from lupin_cli.operations.file import File
from lupin_cli.operations.line_in_file import LineInFile
from lupin_cli.operations.network_connection import NetworkConnection
from lupin_cli.operations.paths import read_file
from lupin_cli.operations.probe import Probe
from lupin_cli.operations.process import Process
from lupin_cli.operations.symlink import Symlink
from lupin_cli.operations.wait_for import WaitFor
from lupin_cli.target.local import LocalTarget


def test_a_file_is_made_and_goes_again(here: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "it's new"
    difference = there_and_back(File(path=str(path), content="a\nb\n", mode="0640"), here)
    assert difference.summary.endswith("is written") and difference.diff.endswith("+a\n+b")
    assert not path.exists()


def test_a_file_is_replaced_and_comes_back_byte_for_byte(here: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "old"
    old = bytes(range(256)) * 100
    path.write_bytes(old)
    path.chmod(0o751)
    there_and_back(File(path=str(path), content="new"), here)
    there_and_back(File(path=str(path), present=False), here)
    there_and_back(File(path=str(path), mode="0600"), here)
    assert (path.read_bytes(), path.stat().st_mode & 0o777) == (old, 0o751)


def test_a_link_in_a_files_place_becomes_a_file_and_a_link_again(here: LocalTarget, tmp_path: Path) -> None:
    (tmp_path / "other").write_text("theirs")
    path = tmp_path / "link"
    path.symlink_to("other")
    there_and_back(File(path=str(path), content="mine"), here)
    assert path.readlink() == Path("other") and (tmp_path / "other").read_text() == "theirs"


def test_the_old_owner_stays_the_owner(here: LocalTarget, tmp_path: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("needs root to give files away")
    path = tmp_path / "theirs"
    path.write_text("old")
    os.chown(path, 65534, 65534)
    operation = File(path=str(path), content="new")
    operation.change(here, operation.differs(here))  # type: ignore[arg-type]
    assert path.stat().st_uid == 65534
    there_and_back(File(path=str(path), owner="root:root"), here)


def test_a_shipped_file_is_put_there_as_it_is(here: LocalTarget, tmp_path: Path) -> None:
    operation = File(path=str(tmp_path / "x"), source="systemd/lupin-clock-sync.sh", mode="0755")
    there_and_back(operation, here)
    with pytest.raises(ValueError, match="ships no"):
        File(path="/x", source="systemd/../pyproject.toml")


def test_a_folder_is_made_with_its_parents_and_goes_with_them(here: LocalTarget, tmp_path: Path) -> None:
    there_and_back(Directory(path=str(tmp_path / "a" / "b c" / "d"), mode="0700"), here)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "there").mkdir(mode=0o755)
    there_and_back(Directory(path=str(tmp_path / "there"), mode="0700"), here)
    there_and_back(Directory(path=str(tmp_path / "there"), present=False), here)


def test_a_folder_that_holds_something_is_not_removed(here: LocalTarget, tmp_path: Path) -> None:
    operation = Directory(path=str(tmp_path / "a"))
    difference = operation.differs(here)
    assert difference is not None
    operation.change(here, difference)
    (tmp_path / "a" / "kept").touch()
    for remove in (
        lambda: operation.undo(here, difference.before),
        lambda: Directory(path=str(tmp_path / "a"), present=False).change(here, difference),
    ):
        with pytest.raises(OperationError, match="could not remove"):
            remove()
    assert (tmp_path / "a" / "kept").exists()


def test_a_link_is_made_turned_and_removed(here: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "current"
    there_and_back(Symlink(path=str(path), to="releases/1"), here)
    path.symlink_to("releases/1")
    there_and_back(Symlink(path=str(path), to="releases/2"), here)
    there_and_back(Symlink(path=str(path), present=False), here)
    path.unlink()
    path.mkdir()
    with pytest.raises(OperationError, match="won't replace it"):
        Symlink(path=str(path), to="x").differs(here)


def test_a_link_is_never_missing_while_it_is_turned(here: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "current"
    path.symlink_to("1")
    watch = "import os,sys\nwhile True:\n try: os.readlink(sys.argv[1])\n except FileNotFoundError: sys.exit(1)\n"
    with subprocess.Popen([sys.executable, "-S", "-c", watch, str(path)]) as watcher:
        try:
            for to in ("2", "1") * 5:
                operation = Symlink(path=str(path), to=to)
                operation.change(here, operation.differs(here))  # type: ignore[arg-type]
                assert watcher.poll() is None
        finally:
            watcher.kill()


@pytest.mark.parametrize(
    ("operation", "text", "edited"),
    [
        ({"line": "b"}, "a\n", "a\nb\n"),
        ({"line": "b"}, "a", "a\nb\n"),
        ({"line": "b"}, "", "b\n"),
        ({"line": "b"}, "a\r\n", "a\r\nb\r\n"),
        ({"line": "export X=2", "matches": r"^\s*export X="}, "export X=1\ny\n  export X=3\n", "y\nexport X=2\n"),
        ({"matches": r"^\s*makestep\b", "state": "commented"}, "\nmakestep\n\n# makestep\n", "\n# makestep\n\n# makestep\n"),
        ({"line": "b", "state": "absent"}, "a\nb\nb\n", "a\n"),
        ({"line": "b", "state": "absent"}, "b\n", ""),
    ],
)  # fmt: skip
def test_lines_are_edited(operation: dict[str, Any], text: str, edited: str) -> None:
    line = LineInFile(path="/x", **operation)
    assert line.edited(text) == edited
    assert line.edited(edited) == edited


@given(
    st.text(alphabet="ab#x=\n", max_size=60),
    st.sampled_from([("x=1", "present"), ("x=1", "absent"), ("x=1", "commented"), ("", "absent"), ("", "commented")]),
)
def test_an_edited_text_is_edited_no_further_and_other_lines_stay(text: str, asked: tuple[str, str]) -> None:
    line = LineInFile(path="/x", line=asked[0], matches="^x=", state=asked[1])
    once = line.edited(text)
    assert line.edited(once) == once
    kept = [each for each in text.removesuffix("\n").split("\n") if not each.startswith("x=")]
    left = [each for each in once.removesuffix("\n").split("\n") if not each.startswith(("x=", "# x="))]
    assert kept == left or (kept == [""] and not left) or (left == [""] and not kept)


def test_a_line_goes_into_a_file_and_out_of_it(here: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "settings.sh"
    path.write_text("export MIRTE_FASTDDS=false\n# end\n")
    path.chmod(0o640)
    there_and_back(LineInFile(path=str(path), line="export MIRTE_FASTDDS=true", matches="MIRTE_FASTDDS="), here)
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("export MIRTE_FASTDDS=false\n# end\n", 0o640)
    there_and_back(LineInFile(path=str(tmp_path / "new"), line="x"), here)
    assert LineInFile(path=str(tmp_path / "none"), matches="x", state="commented").differs(here) is None


def test_a_command_runs_unless_its_guard_holds(here: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "made"
    there_and_back(Command(run=f"touch {path}", creates=str(path), reverse=f"rm -f {path}"), here)
    assert Command(run="false", unless="true").differs(here) is None
    with pytest.raises(OperationError, match=r"could not run 'echo no >&2; exit 3' on robot: no \(status 3\)"):
        operation = Command(run="echo no >&2; exit 3", unless="false")
        operation.change(here, operation.differs(here))  # type: ignore[arg-type]


def test_a_probe_reports_and_changes_nothing(here: LocalTarget) -> None:
    assert Probe(run="echo 1.5; exit 3").report(here) == {"status": 3, "stdout": "1.5", "number": 1.5}
    assert Probe(run="true").differs(here) is None


def test_a_probe_or_a_guard_that_prints_a_hundred_megabytes_is_cut_and_only_what_is_read_is_refused(
    here: LocalTarget, tmp_path: Path
) -> None:
    much = "head -c 100000000 /dev/zero | tr '\\0' x"
    with pytest.raises(OperationError, match=r"printed more than \d+ characters"):
        Probe(run=much, timeout_s=30.0).report(here)
    assert Command(run="false", unless=much).differs(here) is None


def test_a_process_is_ended_by_its_exact_name_and_its_command_line(here: LocalTarget, tmp_path: Path) -> None:
    program = tmp_path / "fast-discovery-server"
    program.write_bytes(Path("/bin/sleep").read_bytes())
    program.chmod(0o755)
    other = tmp_path / "fast-discovery-other"  # the same first 15 characters
    other.write_bytes(program.read_bytes())
    other.chmod(0o755)
    with (
        subprocess.Popen([program, "1001"]) as one,
        subprocess.Popen([program, "1002"]) as two,
        subprocess.Popen([other, "1001"]) as three,
    ):
        try:
            operation = Process(named="fast-discovery-server", holding="1001")
            difference = operation.differs(here)
            assert difference is not None and [entry[0] for entry in difference.before["ended"]] == [one.pid]
            operation.change(here, difference)
            assert operation.differs(here) is None
            assert one.wait(5) == -15 and two.poll() is None and three.poll() is None
            with pytest.raises(OperationError, match="can't be brought back"):
                operation.undo(here, difference.before)
        finally:
            for process in (one, two, three):
                process.kill()


def test_a_process_that_won_t_end_is_killed_and_one_of_the_same_number_is_not(here: LocalTarget, tmp_path: Path) -> None:
    stubborn = "import signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(flush=True); signal.pause()"
    program = tmp_path / "stubborn-lupin"
    program.symlink_to(Path(sys.executable).resolve())
    with subprocess.Popen([program, "-S", "-c", stubborn], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None and process.stdout.readline()
            operation = Process(named="stubborn-lupin", grace_s=0.5)
            difference = operation.differs(here)
            assert difference is not None
            pid, start, command = difference.before["ended"][0]
            another = type(difference)("", "", {"ended": [[pid, start + 1, command]]})
            operation.change(here, another)
            assert process.poll() is None
            operation.change(here, difference)
            assert process.wait(5) == -9
        finally:
            process.kill()


@pytest.mark.parametrize("named", ["", "/bin/sleep", "slee*", "sl[e]ep"])
def test_patterns_and_paths_name_no_process(named: str) -> None:
    with pytest.raises(ValueError, match="exact name"):
        Process(named=named)


def test_what_is_waited_for_is_said(here: LocalTarget, tmp_path: Path) -> None:
    operation = WaitFor(path=str(tmp_path / "flag"))
    difference = operation.differs(here)
    assert difference is not None and difference.summary == f"waits: there is no {tmp_path}/flag"
    (tmp_path / "flag").touch()
    assert operation.differs(here) is None
    with pytest.raises(ValueError, match="exactly one"):
        WaitFor(path="/x", unit="a.service")


def test_paths_that_may_not_be_looked_at_ask_for_root(tmp_path: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("needs root to be somebody else")
    (tmp_path / "closed").mkdir(mode=0o700)
    script = (
        "from lupin_cli.operations.file import File\nfrom lupin_cli.target.local import LocalTarget\n"
        "import os; os.setuid(65534)\n"
        f"File(path={str(tmp_path / 'closed' / 'file')!r}, content='x').differs(LocalTarget('robot'))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30, check=False)
    assert "can't be looked at by nobody; the step needs: root: true" in done.stderr


def test_network_settings_are_compared_as_nmcli_means_them() -> None:
    with pytest.raises(ValueError, match=r"named like ipv4.never-default"):
        NetworkConnection(connection="x", settings={"priority": "1"})


def test_contents_come_whole_whatever_they_are(here: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "x"
    for data in (b"", b"\n", b" whole\n", b"\x00\xff" * 300_000, b"a" * 3_000_000):
        path.write_bytes(data)
        entry, read, also = read_file(here, str(path), False, "echo more")
        assert (entry.kind, read, also) == ("file", data, "more\n")
    assert read_file(here, str(tmp_path), False)[1:] == (None, "")


def test_a_file_that_may_not_be_read_is_an_error_and_not_empty() -> None:
    if os.getuid() != 0:
        pytest.skip("needs root to be somebody else")
    script = (
        "from lupin_cli.operations.paths import read_file\nfrom lupin_cli.target.local import LocalTarget\n"
        "import os; os.setuid(65534)\nprint(read_file(LocalTarget('robot'), '/etc/shadow', False))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode != 0 and "Permission denied" in done.stderr, done.stdout
