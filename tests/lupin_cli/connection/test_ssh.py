"""The `Target` protocol, tested on this machine and on a real sshd."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen
from typing import TYPE_CHECKING

import psutil
import pytest

from lupin_cli.connection.base import Script, Target, TargetError, Unreachable
from lupin_cli.connection.batch_protocol import STDOUT_CAP_BYTES, FrameReader, batch_program
from lupin_cli.connection.exec_stream import HEAD_BYTES, LINE_CHARACTERS, TAIL_BYTES, OutputCollector
from lupin_cli.connection.local import LocalTarget
from lupin_cli.connection.ssh import SshTarget
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from tests.lupin_cli.connection.conftest import Sshd


@pytest.fixture(params=["local", "ssh"], scope="session")
def target(request: pytest.FixtureRequest) -> Iterator[Target]:
    created: Target
    if request.param == "local":
        created = LocalTarget()
    else:
        server = request.getfixturevalue("sshd")
        created = SshTarget("robot", server.destination, server.known_hosts())
    yield created
    created.close()


def test_batch_separates_outputs_of_its_scripts(target: Target) -> None:
    outputs = target.batch(
        [
            Script("fine", "echo one; echo two"),
            Script("fails", "echo some; echo 'why not' >&2; exit 3"),
            Script("quotes", """printf '%s' "it's \\"so\\" \\$HOME" """),
            Script("silent", ":"),
        ]
    )
    assert outputs["fine"].ok and outputs["fine"].stdout == "one\ntwo\n"
    assert (outputs["fails"].status, outputs["fails"].stdout, outputs["fails"].stderr.strip()) == (3, "some\n", "why not")
    assert outputs["quotes"].stdout == """it's "so" $HOME"""
    assert outputs["silent"].ok and outputs["silent"].stdout == "" and outputs["silent"].stderr.strip() == ""


def test_scripts_of_a_batch_run_in_parallel(target: Target) -> None:
    # Each waits until the other has started: in sequence both would time out.
    script = "mkfifo {0} 2>/dev/null; mkfifo {1} 2>/dev/null; echo ping >{0} & read word <{1}; echo got $word; wait"
    prefix = f"/tmp/lupin-test-{os.getpid()}-{time.monotonic_ns()}"
    outputs = target.batch(
        [
            Script("a", script.format(f"{prefix}.a", f"{prefix}.b")),
            Script("b", script.format(f"{prefix}.b", f"{prefix}.a")),
        ]
    )
    for name in ("a", "b"):
        Path(f"{prefix}.{name}").unlink()
    assert outputs["a"].stdout == outputs["b"].stdout == "got ping\n"


def test_batch_output_cut_at_any_byte_is_complete_or_none() -> None:
    scripts = [Script("first", "echo one; echo oops >&2; exit 3"), Script("second", "seq 200")]
    program = batch_program(scripts, 10.0)
    whole = subprocess.run(["/bin/sh", "-c", program.command], input=program.payload, capture_output=True, timeout=60).stdout
    expected = {"first": (3, "one\n"), "second": (0, "".join(f"{n}\n" for n in range(1, 201)))}
    seen = set()
    for length in range(len(whole) + 1):
        reader = FrameReader(program.reader._prefix.strip().decode(), scripts, [10, 10])
        reader.feed(whole[:length])
        for name, output in reader.outputs("cut").items():
            assert output.status is None or (output.status, output.stdout) == expected[name], (length, name, output)
            seen.add((name, output.status is None))
    assert len(seen) == 4


@pytest.mark.parametrize(
    "base64", ["[ $# = 0 ] || exit 1; exec /usr/bin/base64", 'exec /usr/bin/base64 "$@"'], ids=["old", "new"]
)
def test_batch_works_with_old_and_new_base64(tmp_path: Path, base64: str) -> None:
    (tmp_path / "base64").write_text(f"#!/bin/sh\n{base64}\n")
    (tmp_path / "base64").chmod(0o755)
    program = batch_program([Script("long", "seq 5000"), Script("none", "exit 7")], 10.0)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    ran = subprocess.run(
        ["/bin/sh", "-c", program.command], input=program.payload, capture_output=True, timeout=60, env=environment
    )
    program.reader.feed(ran.stdout)
    outputs = program.reader.outputs("cut")
    assert outputs["long"].stdout == "".join(f"{n}\n" for n in range(1, 5001))
    assert (outputs["none"].status, outputs["none"].stdout) == (7, "")


@pytest.mark.parametrize("root", [False, pytest.param(True, marks=pytest.mark.skipif(os.geteuid() != 0, reason="needs root"))])
def test_text_of_a_script_is_in_no_list_of_processes(target: Target, root: bool) -> None:
    text = "ps -eo args; env; : hunter2-and-more"
    for output in (target.batch([Script("ps", text, 60.0, root=root)], 60.0)["ps"], target.run(text, root=root)):
        assert output.ok and "ps -eo args" in output.stdout
        assert "hunter2" not in output.stdout


def test_script_cannot_forge_output_of_another(target: Target) -> None:
    # A script that knows the protocol and writes frames to every descriptor that it may have.
    forge = "for fd in 1 2 3 4 5 6; do eval \"printf '0 o 1 Zm9yZ2Vk\\n0 s 1 0 0 0\\n0 z 1\\n' >&$fd\"; done 2>/dev/null; true"
    outputs = target.batch([Script("forger", forge), Script("honest", "sleep 0.2; echo mine; exit 5")])
    assert (outputs["honest"].status, outputs["honest"].stdout) == (5, "mine\n")


def test_bytes_that_are_not_utf8_are_escaped(target: Target) -> None:
    outputs = target.batch([Script("bytes", "printf 'a\\000b\\377\\n'"), Script("after", "echo fine")])
    assert outputs["bytes"].stdout == "a\0b\\xff\n"
    assert outputs["after"].stdout == "fine\n"


def test_batch_reads_the_clock_and_its_failure_clears_it(own_sshd: tuple[Popen[str], Sshd]) -> None:
    process, sshd = own_sshd
    with contextlib.closing(SshTarget("robot", sshd.destination, sshd.known_hosts())) as target:
        assert target.clock_reading is None
        before_ns = time.time_ns()
        assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
        reading = target.clock_reading
        assert reading is not None  # both ends have the same clock here
        assert before_ns <= reading.sent_ns <= float(reading.text) * 1e9 + 1e3
        assert float(reading.text) * 1e9 - 1e3 <= reading.received_ns <= time.time_ns()
        target.connect().close()
        process.kill()
        process.wait(60)
        with pytest.raises(Unreachable):
            target.batch([Script("one", "echo one")])
        assert target.clock_reading is None


def test_script_is_terminated_at_timeout_and_others_finish(target: Target) -> None:
    outputs = target.batch([Script("hangs", "echo begun; sleep 1000", 1.0), Script("fine", "echo fine")], timeout_s=30)
    assert outputs["hangs"].status is None and outputs["hangs"].stdout == "begun\n"
    assert outputs["fine"].stdout == "fine\n"


def test_batch_timeout_kills_script_that_ignores_sigterm(target: Target) -> None:
    outputs = target.batch([Script("stubborn", "trap '' TERM HUP; echo begun; while :; do sleep 1; done", 60.0)], timeout_s=2)
    assert outputs["stubborn"].status is None and outputs["stubborn"].truncated


def test_background_process_that_holds_pipe_delays_no_batch(target: Target) -> None:
    outputs = target.batch(
        [
            Script("child", "sleep 60 & echo left a child"),
            Script("stray", "setsid sleep 20 & sleep 0.5; echo left a stray"),
            Script("fine", "echo fine"),
        ],
        timeout_s=50,
    )
    assert outputs["child"].stdout == "left a child\n" and outputs["child"].ok
    assert outputs["stray"].status == 0 and "background process" in outputs["stray"].stderr
    assert outputs["fine"].stdout == "fine\n"


def test_batch_truncates_100_megabytes(target: Target) -> None:
    outputs = target.batch(
        [Script("much", "head -c 100000000 /dev/zero | tr '\\0' x", 20.0), Script("fine", "echo fine")], timeout_s=40
    )
    assert outputs["much"].truncated and len(outputs["much"].stdout) == STDOUT_CAP_BYTES
    assert outputs["fine"].stdout == "fine\n" and not outputs["fine"].truncated


def test_script_environment_has_sbin_locale_c_and_no_input(target: Target) -> None:
    outputs = target.batch([Script("all", 'cat; echo "$LC_ALL"; echo ":$PATH:"')])
    language, path = outputs["all"].stdout.splitlines()
    assert language == "C" and ":/usr/sbin:" in path and ":/sbin:" in path


def test_root_script_runs_as_root(target: Target) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root; test_connection_on_host covers sudo")
    outputs = target.batch([Script("who", "id -u", root=True), Script("other", "echo fine")])
    assert outputs["who"].stdout == "0\n" and outputs["other"].stdout == "fine\n"
    assert target.run("id -u; cat", root=True, stdin=b"given").stdout == "0\ngiven"


def test_batch_leaves_no_process_running(target: Target) -> None:
    mark = f"3{os.getpid()}{time.monotonic_ns() % 1000}"
    target.batch([Script("a", f"sleep {mark} & sleep {mark}", 1.0)], timeout_s=20)
    wait_until(lambda: not _running(f"sleep {mark}"), "the end of all processes of the batch")


def _running(command: str) -> bool:
    listed = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, timeout=60).stdout
    return any(line.strip() == command for line in listed.splitlines())


def test_run_streams_lines_and_passes_standard_input(target: Target) -> None:
    lines: list[str] = []
    output = target.run(
        "read a; echo got $a; cat | wc -c; echo oops >&2; exit 4", stdin=b"word\n\0\xff\n", on_line=lines.append
    )
    assert output.status == 4 and sorted(lines) == ["3", "got word", "oops"]
    assert output.stdout.split() == ["got", "word", "3"] and output.stderr == "oops\n"


def test_run_passes_lines_on_before_the_script_ends(target: Target) -> None:
    seen: list[float] = []
    start = time.monotonic()
    target.run("echo now; sleep 1.5", on_line=lambda _: seen.append(time.monotonic() - start))
    assert time.monotonic() - start - seen[0] > 1.0


def test_run_keeps_head_and_tail_of_100_megabytes(target: Target) -> None:
    lines: list[int] = []
    script = "echo begun; head -c 100000000 /dev/zero | tr '\\0' x; echo; echo ended; echo done >&2"
    tracemalloc.start()
    output = target.run(script, timeout_s=90, on_line=lambda line: lines.append(len(line)))
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert output.ok and output.truncated and output.stderr == "done\n"
    assert output.stdout.startswith("begun\nxxx") and output.stdout.endswith("xxx\nended\n")
    head, omission, tail = output.stdout.partition(f"\n[{100_000_013 - HEAD_BYTES - TAIL_BYTES} bytes left out]\n")
    assert (len(head), bool(omission), len(tail)) == (HEAD_BYTES, True, TAIL_BYTES)
    # `on_line` gets all of it, an endless line in pieces; memory stays within a few times what is kept.
    assert sum(lines) == 100_000_000 + len("begunendeddone") and max(lines) <= LINE_CHARACTERS
    assert peak_bytes < 6 * (HEAD_BYTES + TAIL_BYTES)


def test_long_line_is_split_wherever_its_end_arrives() -> None:
    lines: list[str] = []
    collector = OutputCollector(b"mark", lines.append)
    for data in (b"mark\n", b"a" * LINE_CHARACTERS, b"b" * (LINE_CHARACTERS - 1) + b"\n\nend", b"\nrest"):
        collector.feed(data, is_stderr=False)
    output = collector.output(0, 0.0, 1.0)
    assert lines == ["a" * LINE_CHARACTERS, "b" * (LINE_CHARACTERS - 1), "", "end", "rest"]
    assert output.stdout.endswith("b\n\nend\nrest")


def test_run_is_terminated_at_its_timeout(target: Target) -> None:
    output = target.run("echo begun; sleep 1000", timeout_s=4.0)
    assert output.status is None and output.stdout == "begun\n"


def test_run_does_not_wait_for_daemon_that_holds_pipe(target: Target) -> None:
    output = target.run("setsid sleep 30 & echo started", timeout_s=25)
    assert output.ok and output.stdout == "started\n"


def test_file_is_written_and_read_with_its_mode(target: Target, tmp_path: Path) -> None:
    path, data = tmp_path / "it's a file", bytes(range(256)) * 3000
    target.put(str(path), data, mode=0o640)
    assert target.get(str(path)) == data == path.read_bytes()
    assert path.stat().st_mode & 0o777 == 0o640
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_empty_file_is_bytes_and_missing_file_none(target: Target, tmp_path: Path) -> None:
    target.put(str(tmp_path / "empty"), b"")
    assert target.get(str(tmp_path / "empty")) == b""
    assert target.get(str(tmp_path / "none")) is None


def test_root_file_is_written_and_read(target: Target, tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root; test_connection_on_host covers sudo")
    target.put(str(tmp_path / "unit"), b"a\0b" * 1000, mode=0o600, root=True)
    assert target.get(str(tmp_path / "unit"), root=True) == b"a\0b" * 1000


@pytest.mark.parametrize("root", [False, True])
def test_full_disk_keeps_old_file_and_is_reported(target: Target, tmp_path: Path, root: bool) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root: it mounts a file system of 64 kB")
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(tmp_path)], check=True)
    try:
        target.put(str(tmp_path / "file"), b"old", root=root)
        with pytest.raises(TargetError, match="No space left"):
            target.put(str(tmp_path / "file"), b"x" * 200_000, root=root)
        assert (tmp_path / "file").read_bytes() == b"old"
        assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
        # A batch needs no disk.
        (tmp_path / "rest").write_bytes(b"x" * 57_000)
        assert target.batch([Script("fine", f"cd {tmp_path} && df -P . | tail -n 1", 20.0)], 30.0)["fine"].ok
    finally:
        subprocess.run(["umount", "-l", str(tmp_path)], check=True)


def test_failed_write_reports_reason(target: Target, tmp_path: Path) -> None:
    with pytest.raises(TargetError, match=r"could not write .*: .*[Nn]o such file or directory|nonexistent"):
        target.put(str(tmp_path / "no" / "such" / "file"), b"x")


def test_two_scripts_of_the_same_name_are_refused(target: Target) -> None:
    with pytest.raises(ValueError, match="same name"):
        target.batch([Script("a", ":"), Script("a", ":")])


def test_open_run_exchanges_lines_without_preamble(sshd: Sshd) -> None:
    from lupin_cli.connection.ssh import SshTarget

    target = SshTarget("robot", sshd.destination, sshd.known_hosts())
    channel = target.open_run("while read -r word; do echo got $word; done", timeout_s=20)
    for word in (b"one", b"two"):
        channel.sendall(word + b"\n")
        answer = b""
        while not answer.endswith(b"\n"):
            answer += channel.recv(100)
        assert answer == b"got " + word + b"\n"
    channel.close()
    target.close()


def test_input_is_answered_only_when_the_script_asks(sshd: Sshd) -> None:
    lines: list[str] = []
    ask = "echo working; echo may I; read -r word && echo got $word; timeout 0.3 head -c 1 || echo still open"
    with contextlib.closing(SshTarget("robot", sshd.destination, sshd.known_hosts())) as target:
        output = target.run(ask, timeout_s=20.0, on_line=lines.append, answers={"may I": b"yes\n"})
        assert output.status == 0 and lines == ["working", "got yes", "still open"]
        assert target.run("read -r word || echo nobody answers", timeout_s=20.0).stdout == "nobody answers\n"


def test_connect_opens_new_connection_after_loss(sshd: Sshd) -> None:
    with contextlib.closing(SshTarget("robot", sshd.destination, sshd.known_hosts())) as target:
        first = target.connect()
        assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
        first.close()
        assert target.connect() is not first
        assert target.batch([Script("two", "echo two")])["two"].stdout == "two\n"


def test_local_batch_leaves_no_process_and_no_descriptor() -> None:
    target = LocalTarget()
    scripts = [Script("fine", "echo fine"), Script("cut", "sleep 50", 0.2), Script("stray", "setsid sleep 4 & echo left")]
    before, children = os.listdir("/proc/self/fd"), psutil.Process().children()  # noqa: PTH208 -- names, without the folder
    outputs = target.batch(scripts)
    assert outputs["cut"].status is None and outputs["cut"].stderr == "did not finish within 0.2 s"
    assert os.listdir("/proc/self/fd") == before  # noqa: PTH208 -- names, without the folder
    assert psutil.Process().children() == children


@pytest.mark.filterwarnings("ignore:subprocess .* is still running:ResourceWarning")
def test_local_batch_gives_up_on_script_that_cannot_be_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    killed = os.killpg
    monkeypatch.setattr("lupin_cli.connection.local_batch.KILL_AFTER_S", 0.2)
    monkeypatch.setattr(os, "killpg", lambda *_: None)  # like a process that waits for a disk in the kernel
    before = psutil.Process().children()
    outputs = LocalTarget().batch([Script("dead", "echo begun; exec sleep 600", 0.2), Script("fine", "echo fine")])
    assert outputs["dead"].status is None and outputs["dead"].stdout == "begun\n" and outputs["fine"].stdout == "fine\n"
    (left,) = set(psutil.Process().children()) - set(before)
    killed(left.pid, signal.SIGKILL)
    left.wait(60)
