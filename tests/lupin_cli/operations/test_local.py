"""Operations on files, links, directories, commands and processes, on this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.operations import OperationError
from lupin_cli.operations.command import Command
from lupin_cli.operations.directory import Directory
from lupin_cli.operations.file import File
from lupin_cli.operations.line_in_file import LineInFile
from lupin_cli.operations.network_connection import NetworkConnection
from lupin_cli.operations.path_state import FileState, complete_file, file_script, parse_file
from lupin_cli.operations.probe import Probe
from lupin_cli.operations.process import Process
from lupin_cli.operations.shell import query
from lupin_cli.operations.symlink import Symlink
from lupin_cli.operations.wait_for import WaitFor
from tests.support.operation_cycle import apply, apply_and_undo, examine, report

if TYPE_CHECKING:
    from lupin_cli.connection.local import LocalTarget


def test_file_is_created_and_undo_removes_it(target: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "it's new"
    difference = apply_and_undo(File(path=str(path), content="a\nb\n", mode="0640"), target)
    assert difference.summary == f"create {path}" and difference.diff.endswith("+a\n+b")
    assert not path.exists()


def test_file_is_replaced_and_restored_byte_for_byte(target: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "old"
    old = bytes(range(256)) * 100
    path.write_bytes(old)
    path.chmod(0o751)
    apply_and_undo(File(path=str(path), content="new"), target)
    apply_and_undo(File(path=str(path), present=False), target)
    apply_and_undo(File(path=str(path), mode="0600"), target)
    assert (path.read_bytes(), path.stat().st_mode & 0o777) == (old, 0o751)


def test_file_replaces_a_link_and_undo_restores_the_link(target: LocalTarget, tmp_path: Path) -> None:
    (tmp_path / "other").write_text("theirs")
    path = tmp_path / "link"
    path.symlink_to("other")
    apply_and_undo(File(path=str(path), content="mine"), target)
    assert path.readlink() == Path("other") and (tmp_path / "other").read_text() == "theirs"


def test_file_keeps_its_owner(target: LocalTarget, tmp_path: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("needs root: chown")
    path = tmp_path / "theirs"
    path.write_text("old")
    os.chown(path, 65534, 65534)
    operation = File(path=str(path), content="new")
    apply(operation, target)
    assert path.stat().st_uid == 65534
    apply_and_undo(File(path=str(path), owner="root:root"), target)


def test_file_source_must_be_shipped_with_lupin(target: LocalTarget, tmp_path: Path) -> None:
    operation = File(path=str(tmp_path / "x"), source="systemd/lupin-clock-sync.sh", mode="0755")
    apply_and_undo(operation, target)
    with pytest.raises(ValueError, match="ships no"):
        File(path="/x", source="systemd/../pyproject.toml")


def test_directory_is_created_and_removed_with_its_parents(target: LocalTarget, tmp_path: Path) -> None:
    apply_and_undo(Directory(path=str(tmp_path / "a" / "b c" / "d"), mode="0700"), target)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "existing").mkdir(mode=0o755)
    apply_and_undo(Directory(path=str(tmp_path / "existing"), mode="0700"), target)
    apply_and_undo(Directory(path=str(tmp_path / "existing"), present=False), target)


def test_directory_that_is_not_empty_is_not_removed(target: LocalTarget, tmp_path: Path) -> None:
    operation = Directory(path=str(tmp_path / "a"))
    difference = apply(operation, target)
    (tmp_path / "a" / "kept").touch()
    for remove in (
        lambda: operation.undo(target, difference.before),
        lambda: Directory(path=str(tmp_path / "a"), present=False).change(target, difference),
    ):
        with pytest.raises(OperationError, match="could not remove"):
            remove()  # type: ignore[no-untyped-call]
    assert (tmp_path / "a" / "kept").exists()


def test_symlink_is_created_replaced_and_removed(target: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "current"
    apply_and_undo(Symlink(path=str(path), to="releases/1"), target)
    path.symlink_to("releases/1")
    apply_and_undo(Symlink(path=str(path), to="releases/2"), target)
    apply_and_undo(Symlink(path=str(path), present=False), target)
    path.unlink()
    path.mkdir()
    with pytest.raises(OperationError, match="won't replace it"):
        examine(Symlink(path=str(path), to="x"), target)


def test_symlink_is_never_missing_while_it_is_replaced(target: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "current"
    path.symlink_to("1")
    watch = "import os,sys\nwhile True:\n try: os.readlink(sys.argv[1])\n except FileNotFoundError: sys.exit(1)\n"
    with subprocess.Popen([sys.executable, "-S", "-c", watch, str(path)]) as watcher:
        try:
            for to in ("2", "1") * 5:
                operation = Symlink(path=str(path), to=to)
                apply(operation, target)
                assert watcher.poll() is None
        finally:
            watcher.kill()


@pytest.mark.parametrize(
    ("arguments", "text", "expected"),
    [
        ({"line": "b"}, "a\n", "a\nb\n"),
        ({"line": "b"}, "a", "a\nb\n"),
        ({"line": "b"}, "", "b\n"),
        ({"line": "b"}, "a\r\n", "a\r\nb\r\n"),
        ({"line": "export X=2", "matches": r"^\s*export X="}, "export X=1\ny\n  export X=3\n", "y\nexport X=2\n"),
        ({"matches": r"^\s*makestep\b", "state": "commented"}, "\nmakestep\n\n# makestep\n", "\n# makestep\n\n# makestep\n"),
        ({"line": "b", "state": "absent"}, "a\nb\nb\n", "a\n"),
        ({"line": "b", "state": "absent"}, "b\n", ""),
        ({"line": "b", "state": "absent"}, "a\n\nb", "a\n\n"),
    ],
)  # fmt: skip
def test_line_in_file_edits_text(arguments: dict[str, Any], text: str, expected: str) -> None:
    operation = LineInFile(path="/x", **arguments)
    assert operation.edit(text) == expected
    assert operation.edit(expected) == expected


@given(
    st.text(alphabet="ab#x=\n", max_size=60),
    st.sampled_from([("x=1", "present"), ("x=1", "absent"), ("x=1", "commented"), ("", "absent"), ("", "commented")]),
)
def test_line_in_file_is_idempotent_and_keeps_other_lines(text: str, line_and_state: tuple[str, str]) -> None:
    line, state = line_and_state
    operation = LineInFile(path="/x", line=line, matches="^x=", state=state)
    once = operation.edit(text)
    assert operation.edit(once) == once
    others_before = [each for each in text.removesuffix("\n").split("\n") if not each.startswith("x=")]
    others_after = [each for each in once.removesuffix("\n").split("\n") if not each.startswith(("x=", "# x="))]
    is_same = others_before == others_after
    assert is_same or (others_before == [""] and not others_after) or (others_after == [""] and not others_before)


def test_line_in_file_is_set_and_undone(target: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "settings.sh"
    path.write_text("export MIRTE_FASTDDS=false\n# end\n")
    path.chmod(0o640)
    apply_and_undo(LineInFile(path=str(path), line="export MIRTE_FASTDDS=true", matches="MIRTE_FASTDDS="), target)
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("export MIRTE_FASTDDS=false\n# end\n", 0o640)
    apply_and_undo(LineInFile(path=str(tmp_path / "new"), line="x"), target)
    assert examine(LineInFile(path=str(tmp_path / "none"), matches="x", state="commented"), target) is None


def test_command_runs_unless_its_guard_holds(target: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "made"
    apply_and_undo(Command(run=f"touch {path}", creates=str(path), reverse=f"rm -f {path}"), target)
    assert examine(Command(run="false", unless="true"), target) is None
    operation = Command(run="echo no >&2; exit 3", unless="false")
    with pytest.raises(OperationError, match=r"could not run 'echo no >&2; exit 3' on robot: no \(status 3\)"):
        apply(operation, target)


def test_probe_reports_output_and_has_no_difference(target: LocalTarget) -> None:
    assert report(Probe(run="echo 1.5; exit 3"), target) == {"status": 3, "stdout": "1.5", "number": 1.5}
    assert examine(Probe(run="true"), target) is None


PRINT_100_MB = "head -c 100000000 /dev/zero | tr '\\0' x"


def test_probe_rejects_100_mb_of_output(target: LocalTarget) -> None:
    with pytest.raises(OperationError, match=r"printed more than \d+ characters"):
        report(Probe(run=PRINT_100_MB, timeout_s=30.0), target)


def test_guard_discards_100_mb_of_output(target: LocalTarget) -> None:
    assert examine(Command(run="false", unless=PRINT_100_MB), target) is None


def test_process_is_found_by_exact_name_and_command_line(target: LocalTarget, tmp_path: Path) -> None:
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
            difference = examine(operation, target)
            assert difference is not None and [entry[0] for entry in difference.before["ended"]] == [one.pid]
            operation.change(target, difference)
            assert examine(operation, target) is None
            assert one.wait(60) == -15 and two.poll() is None and three.poll() is None
            with pytest.raises(OperationError, match="cannot be restored"):
                operation.undo(target, difference.before)
        finally:
            for process in (one, two, three):
                process.kill()


def test_process_ignoring_term_is_killed_if_start_matches(target: LocalTarget, tmp_path: Path) -> None:
    stubborn = "import signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(flush=True); signal.pause()"
    program = tmp_path / "stubborn-lupin"
    program.symlink_to(Path(sys.executable).resolve())
    with subprocess.Popen([program, "-S", "-c", stubborn], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None and process.stdout.readline()
            operation = Process(named="stubborn-lupin", grace_s=0.5)
            difference = examine(operation, target)
            assert difference is not None
            pid, start, command = difference.before["ended"][0]
            another = type(difference)("", "", {"ended": [[pid, start + 1, command]]})
            operation.change(target, another)
            assert process.poll() is None
            operation.change(target, difference)
            assert process.wait(60) == -9
        finally:
            process.kill()


@pytest.mark.parametrize("named", ["", "/bin/sleep", "slee*", "sl[e]ep"])
def test_process_refuses_patterns_and_paths(named: str) -> None:
    with pytest.raises(ValueError, match="exact name"):
        Process(named=named)


def test_wait_for_summary_names_the_missing_path(target: LocalTarget, tmp_path: Path) -> None:
    operation = WaitFor(path=str(tmp_path / "flag"))
    difference = examine(operation, target)
    assert difference is not None and difference.summary == f"wait: {tmp_path}/flag does not exist"
    (tmp_path / "flag").touch()
    assert examine(operation, target) is None
    with pytest.raises(ValueError, match="exactly one"):
        WaitFor(path="/x", unit="a.service")


def test_file_in_an_inaccessible_directory_needs_root(tmp_path: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("needs root: setuid")
    (tmp_path / "closed").mkdir(mode=0o700)
    script = (
        "from lupin_cli.operations.file import File\nfrom lupin_cli.connection.local import LocalTarget\n"
        "from tests.support.operation_cycle import examine\n"
        "import os; os.setuid(65534)\n"
        f"examine(File(path={str(tmp_path / 'closed' / 'file')!r}, content='x'), LocalTarget('robot'))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert "cannot be examined by this user; the step needs: root: true" in done.stderr


def test_network_connection_refuses_invalid_setting_names() -> None:
    with pytest.raises(ValueError, match=r"named like ipv4.never-default"):
        NetworkConnection(connection="x", settings={"priority": "1"})


def read_state(target: LocalTarget, path: Path, extra: str) -> FileState:
    output = query(target, file_script(str(path), extra))
    return parse_file(complete_file(target, output, str(path), root=False), str(path))


def test_file_content_of_any_size_is_read_completely(target: LocalTarget, tmp_path: Path) -> None:
    path = tmp_path / "x"
    for data in (b"", b"\n", b" whole\n", b"\x00\xff" * 300_000, b"a" * 3_000_000):
        path.write_bytes(data)
        state = read_state(target, path, "echo more")
        assert (state.kind, state.content, state.extra) == ("file", data, "more\n")
    directory = read_state(target, tmp_path, "")
    assert (directory.kind, directory.content, directory.extra) == ("directory", None, "")


def test_file_without_read_permission_is_an_error() -> None:
    if os.getuid() != 0:
        pytest.skip("needs root: setuid")
    script = (
        "from lupin_cli.operations.file import File\nfrom lupin_cli.connection.local import LocalTarget\n"
        "from tests.support.operation_cycle import examine\n"
        "import os; os.setuid(65534)\nprint(examine(File(path='/etc/shadow', mode='0640'), LocalTarget('robot')))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode != 0 and "Permission denied" in done.stderr, done.stdout


# Every way to write a mode, beside and below folders with each of the special bits: the first run makes it, the second has
# nothing to do, and undo restores all twelve bits.
@pytest.mark.parametrize("parent", [0o755, 0o1777, 0o2775, 0o4755, 0o6777])
@pytest.mark.parametrize("mode", ["755", "0755", "2775", "02775", "1777", "00755", "0000", "6755"])
def test_folder_with_any_mode_converges(target: LocalTarget, tmp_path: Path, parent: int, mode: str) -> None:
    farm = tmp_path / "farm"
    farm.mkdir()
    farm.chmod(parent)
    apply_and_undo(Directory(path=str(farm / "data" / "inner"), mode=mode), target)
    assert not (farm / "data").exists()
    if examine(Directory(path=str(farm), mode=mode), target) is not None:
        apply_and_undo(Directory(path=str(farm), mode=mode), target)
    assert farm.stat().st_mode & 0o7777 == parent


@pytest.mark.parametrize("mode", ["644", "0644", "4755", "2755", "1644", "06711"])
def test_file_with_any_mode_converges(target: LocalTarget, tmp_path: Path, mode: str) -> None:
    tmp_path.chmod(0o2775)
    path = tmp_path / "program"
    apply_and_undo(File(path=str(path), content="a", mode=mode), target)
    path.write_text("b")
    path.chmod(0o6755)
    apply_and_undo(File(path=str(path), mode=mode), target)
    assert path.stat().st_mode & 0o7777 == 0o6755
