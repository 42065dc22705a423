"""What every target promises, asked of this machine and of a real sshd."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import paramiko
import psutil
import pytest

from lupin_cli.target.base import Script, Target, TargetError, Unreachable
from lupin_cli.target.destination import Destination
from lupin_cli.target.framing import READ_BATCH, STDOUT_CAP_BYTES, FrameReader, batch_program
from lupin_cli.target.local import LocalTarget
from lupin_cli.target.reach import Knock
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.streaming import HEAD_BYTES, LINE_CHARACTERS, TAIL_BYTES, Streams
from lupin_cli.target.trust import Trust


@pytest.fixture(params=["local", "ssh"], scope="session")
def target(request: pytest.FixtureRequest) -> Iterator[Target]:
    made: Target
    if request.param == "local":
        made = LocalTarget()
    else:
        server = request.getfixturevalue("sshd")
        made = SshTarget("robot", server.destination, server.trust())
    yield made
    made.close()


def test_a_batch_keeps_status_output_and_error_of_each_script_apart(target: Target) -> None:
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


def test_scripts_of_a_batch_run_side_by_side(target: Target) -> None:
    # Each waits until the other has begun: one after the other they would both be cut.
    script = "mkfifo {0} 2>/dev/null; mkfifo {1} 2>/dev/null; echo here >{0} & read word <{1}; echo got $word; wait"
    place = f"/tmp/lupin-test-{os.getpid()}-{time.monotonic_ns()}"
    outputs = target.batch(
        [
            Script("a", script.format(f"{place}.a", f"{place}.b")),
            Script("b", script.format(f"{place}.b", f"{place}.a")),
        ]
    )
    for name in ("a", "b"):
        Path(f"{place}.{name}").unlink()
    assert outputs["a"].stdout == outputs["b"].stdout == "got here\n"


def test_an_answer_that_is_cut_at_any_byte_is_whole_or_none() -> None:
    scripts = [Script("first", "echo one; echo oops >&2; exit 3"), Script("second", "seq 200")]
    program = batch_program(scripts, 10.0)
    whole = subprocess.run(["/bin/sh", "-c", READ_BATCH], input=program.payload, capture_output=True, timeout=30).stdout
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
def test_an_old_base64_that_only_knows_short_lines_serves_as_well(tmp_path: Path, base64: str) -> None:
    (tmp_path / "base64").write_text(f"#!/bin/sh\n{base64}\n")
    (tmp_path / "base64").chmod(0o755)
    program = batch_program([Script("long", "seq 5000"), Script("none", "exit 7")], 10.0)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    ran = subprocess.run(["/bin/sh", "-c", READ_BATCH], input=program.payload, capture_output=True, timeout=30, env=environment)
    program.reader.feed(ran.stdout)
    outputs = program.reader.outputs("cut")
    assert outputs["long"].stdout == "".join(f"{n}\n" for n in range(1, 5001))
    assert (outputs["none"].status, outputs["none"].stdout) == (7, "")


def test_no_output_passes_for_another_scripts(target: Target) -> None:
    # A script that knows the framing, and shouts frames at every descriptor that it may have.
    forge = "for fd in 1 2 3 4 5 6; do eval \"printf '0 o 1 Zm9yZ2Vk\\n0 s 1 0 0 0\\n0 z 1\\n' >&$fd\"; done 2>/dev/null; true"
    outputs = target.batch([Script("forger", forge), Script("honest", "sleep 0.2; echo mine; exit 5")])
    assert (outputs["honest"].status, outputs["honest"].stdout) == (5, "mine\n")


def test_bytes_that_are_no_text_are_shown_and_break_nothing(target: Target) -> None:
    outputs = target.batch([Script("bytes", "printf 'a\\000b\\377\\n'"), Script("after", "echo fine")])
    assert outputs["bytes"].stdout == "a\0b\\xff\n"
    assert outputs["after"].stdout == "fine\n"


def test_a_batch_tells_what_the_clock_said_and_when(sshd) -> None:
    with contextlib.closing(SshTarget("robot", sshd.destination, sshd.trust())) as target:
        assert target.clock_reading is None
        before_ns = time.time_ns()
        assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
        reading = target.clock_reading
        assert reading is not None  # of the same clock, here
        assert before_ns <= reading.sent_ns <= float(reading.said) * 1e9 + 1e3
        assert float(reading.said) * 1e9 - 1e3 <= reading.heard_ns <= time.time_ns()
        with pytest.raises(Unreachable):
            target.connect().close()
            target.destination = Destination("127.0.0.1", 1)
            target.batch([Script("one", "echo one")])
        assert target.clock_reading is None


def test_a_script_that_does_not_end_is_cut_and_the_others_are_not(target: Target) -> None:
    start = time.monotonic()
    outputs = target.batch([Script("hangs", "echo begun; sleep 100", 1.0), Script("fine", "echo fine")], bound_s=30)
    assert time.monotonic() - start < 25
    assert outputs["hangs"].status is None and outputs["hangs"].stdout == "begun\n"
    assert outputs["fine"].stdout == "fine\n"


def test_the_bound_of_the_batch_ends_what_ignores_its_own(target: Target) -> None:
    start = time.monotonic()
    outputs = target.batch([Script("stubborn", "trap '' TERM HUP; echo begun; while :; do sleep 1; done", 60.0)], bound_s=2)
    assert time.monotonic() - start < 25
    assert outputs["stubborn"].status is None and outputs["stubborn"].truncated


def test_a_child_left_behind_with_the_pipe_in_hand_holds_nothing_up(target: Target) -> None:
    start = time.monotonic()
    outputs = target.batch(
        [
            Script("child", "sleep 60 & echo left a child"),
            Script("stray", "setsid sleep 20 & sleep 0.5; echo left a stray"),
            Script("fine", "echo fine"),
        ],
        bound_s=50,
    )
    assert time.monotonic() - start < 15
    assert outputs["child"].stdout == "left a child\n" and outputs["child"].ok
    assert outputs["stray"].status == 0 and "left behind" in outputs["stray"].stderr
    assert outputs["fine"].stdout == "fine\n"


def test_a_hundred_megabytes_are_cut_and_said_to_be(target: Target) -> None:
    outputs = target.batch(
        [Script("much", "head -c 100000000 /dev/zero | tr '\\0' x", 20.0), Script("fine", "echo fine")], bound_s=40
    )
    assert outputs["much"].truncated and len(outputs["much"].stdout) == STDOUT_CAP_BYTES
    assert outputs["fine"].stdout == "fine\n" and not outputs["fine"].truncated


def test_scripts_find_the_administrators_programs_in_one_language_with_nothing_to_read(target: Target) -> None:
    outputs = target.batch([Script("all", 'cat; echo "$LC_ALL"; echo ":$PATH:"')])
    language, path = outputs["all"].stdout.splitlines()
    assert language == "C" and ":/usr/sbin:" in path and ":/sbin:" in path


def test_a_root_script_is_root(target: Target) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root; with sudo it is tested on the booted host")
    outputs = target.batch([Script("who", "id -u", root=True), Script("other", "echo fine")])
    assert outputs["who"].stdout == "0\n" and outputs["other"].stdout == "fine\n"
    assert target.run("id -u; cat", root=True, stdin=b"given").stdout == "0\ngiven"


def test_nothing_of_a_batch_is_left_running(target: Target) -> None:
    mark = f"3{os.getpid()}{time.monotonic_ns() % 1000}"
    target.batch([Script("a", f"sleep {mark} & sleep {mark}", 1.0)], bound_s=20)
    deadline = time.monotonic() + 15
    while time.monotonic() < deadline and _running(f"sleep {mark}"):
        time.sleep(0.05)
    assert not _running(f"sleep {mark}")


def _running(command: str) -> bool:
    said = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, timeout=20).stdout
    return any(line.strip() == command for line in said.splitlines())


def test_run_streams_lines_and_hands_over_standard_input(target: Target) -> None:
    lines: list[str] = []
    output = target.run(
        "read a; echo got $a; cat | wc -c; echo oops >&2; exit 4", stdin=b"word\n\0\xff\n", on_line=lines.append
    )
    assert output.status == 4 and sorted(lines) == ["3", "got word", "oops"]
    assert output.stdout.split() == ["got", "word", "3"] and output.stderr == "oops\n"


def test_run_hands_over_lines_before_the_script_ends(target: Target) -> None:
    seen: list[float] = []
    start = time.monotonic()
    target.run("echo now; sleep 1.5", on_line=lambda _: seen.append(time.monotonic() - start))
    assert time.monotonic() - start - seen[0] > 1.0


def test_of_a_hundred_megabytes_from_a_run_both_ends_are_kept_and_said_so(target: Target) -> None:
    lines: list[int] = []
    script = "echo begun; head -c 100000000 /dev/zero | tr '\\0' x; echo; echo ended; echo done >&2"
    tracemalloc.start()
    output = target.run(script, bound_s=90, on_line=lambda line: lines.append(len(line)))
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert output.ok and output.truncated and output.stderr == "done\n"
    assert output.stdout.startswith("begun\nxxx") and output.stdout.endswith("xxx\nended\n")
    head, said, tail = output.stdout.partition(f"\n[{100_000_013 - HEAD_BYTES - TAIL_BYTES} bytes left out]\n")
    assert (len(head), bool(said), len(tail)) == (HEAD_BYTES, True, TAIL_BYTES)
    # A listener gets all of it, a line without an end in pieces; nothing holds more than what is kept, a few times over.
    assert sum(lines) == 100_000_000 + len("begunendeddone") and max(lines) <= LINE_CHARACTERS
    assert peak_bytes < 6 * (HEAD_BYTES + TAIL_BYTES)


def test_a_long_line_comes_in_pieces_wherever_its_end_arrives() -> None:
    told: list[str] = []
    streams = Streams(b"mark", told.append)
    for data in (b"mark\n", b"a" * LINE_CHARACTERS, b"b" * (LINE_CHARACTERS - 1) + b"\n\nend", b"\nrest"):
        streams.feed(data, is_stderr=False)
    output = streams.output(0, 0.0, 1.0)
    assert told == ["a" * LINE_CHARACTERS, "b" * (LINE_CHARACTERS - 1), "", "end", "rest"]
    assert output.stdout.endswith("b\n\nend\nrest")


def test_run_is_cut_at_its_bound(target: Target) -> None:
    start = time.monotonic()
    output = target.run("echo begun; sleep 100", bound_s=4.0)
    assert time.monotonic() - start < 30
    assert output.status is None and output.stdout == "begun\n"


def test_run_does_not_wait_for_a_daemon_that_kept_its_pipe(target: Target) -> None:
    start = time.monotonic()
    output = target.run("setsid sleep 30 & echo started", bound_s=25)
    assert time.monotonic() - start < 20
    assert output.ok and output.stdout == "started\n"


def test_a_file_comes_back_byte_for_byte_with_its_mode(target: Target, tmp_path: Path) -> None:
    path, data = tmp_path / "it's a file", bytes(range(256)) * 3000
    target.put(str(path), data, mode=0o640)
    assert target.get(str(path)) == data == path.read_bytes()
    assert path.stat().st_mode & 0o777 == 0o640
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_an_empty_file_is_a_file_and_a_missing_one_is_none(target: Target, tmp_path: Path) -> None:
    target.put(str(tmp_path / "empty"), b"")
    assert target.get(str(tmp_path / "empty")) == b""
    assert target.get(str(tmp_path / "none")) is None


def test_a_root_file_is_written_whole(target: Target, tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root; with sudo it is tested on the booted host")
    target.put(str(tmp_path / "unit"), b"a\0b" * 1000, mode=0o600, root=True)
    assert target.get(str(tmp_path / "unit"), root=True) == b"a\0b" * 1000


@pytest.mark.parametrize("root", [False, True])
def test_a_full_disk_leaves_the_old_file_whole_and_says_so(target: Target, tmp_path: Path, root: bool) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root: it mounts a file system of 64 kB")
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(tmp_path)], check=True)
    try:
        target.put(str(tmp_path / "file"), b"old", root=root)
        with pytest.raises(TargetError, match="No space left"):
            target.put(str(tmp_path / "file"), b"x" * 200_000, root=root)
        assert (tmp_path / "file").read_bytes() == b"old"
        assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
        # And a batch needs no disk at all.
        (tmp_path / "rest").write_bytes(b"x" * 57_000)
        assert target.batch([Script("fine", f"cd {tmp_path} && df -P . | tail -n 1", 20.0)], 30.0)["fine"].ok
    finally:
        subprocess.run(["umount", "-l", str(tmp_path)], check=True)


def test_a_file_that_cannot_be_written_says_why(target: Target, tmp_path: Path) -> None:
    with pytest.raises(TargetError, match=r"could not write .*: .*[Nn]o such file or directory|nonexistent"):
        target.put(str(tmp_path / "no" / "such" / "file"), b"x")


def test_two_scripts_of_one_name_are_refused(target: Target) -> None:
    with pytest.raises(ValueError, match="one name"):
        target.batch([Script("a", ":"), Script("a", ":")])


def test_an_open_channel_carries_an_exchange_and_nothing_before_it(sshd) -> None:
    from lupin_cli.target.ssh import SshTarget

    target = SshTarget("robot", sshd.destination, sshd.trust())
    channel = target.open_run("while read -r word; do echo got $word; done", bound_s=20)
    for word in (b"one", b"two"):
        channel.sendall(word + b"\n")
        said = b""
        while not said.endswith(b"\n"):
            said += channel.recv(100)
        assert said == b"got " + word + b"\n"
    channel.close()
    target.close()


def test_a_shell_that_was_made_ready_runs_the_next_batch_and_no_other_one(sshd, monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[str] = []
    run = paramiko.Channel.exec_command
    monkeypatch.setattr(paramiko.Channel, "exec_command", lambda self, command: commands.append(command) or run(self, command))
    with contextlib.closing(SshTarget("robot", sshd.destination, sshd.trust())) as target:
        target.get_ready()
        target.get_ready()  # as a watch does that asks nothing: one shell waits, not one a look
        assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
        assert len(commands) == 1
        assert target.batch([Script("two", "echo two")])["two"].stdout == "two\n"
        assert len(commands) == 2
        target.get_ready()
        target.connect().close()  # the link went, and the shell with it
        assert target.batch([Script("three", "echo three")])["three"].stdout == "three\n"
        target.get_ready()  # for nothing: it goes with the connection


def test_who_has_knocked_is_let_in_once_and_knocks_anew_after_that(sshd) -> None:
    with contextlib.closing(SshTarget("robot", sshd.destination, sshd.trust(), knock=Knock(sshd.destination))) as target:
        first = target.connect()
        assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
        first.close()
        assert target.connect() is not first


def test_a_knock_that_nobody_waits_for_leaves_no_connection(sshd) -> None:
    knock = Knock(sshd.destination)
    SshTarget("robot", sshd.destination, sshd.trust(), knock=knock).close()
    assert knock.take().fileno() == -1


def test_a_knock_at_a_closed_port_is_told_as_any_connection_is() -> None:
    nowhere = Destination("127.0.0.1", 1, "mirte")
    with pytest.raises(Unreachable) as told:
        SshTarget("robot", nowhere, Trust(Path("/none"), Path("/none")), knock=Knock(nowhere)).connect()
    assert told.value.kind == "refused"


def test_a_batch_leaves_no_process_and_no_descriptor_open() -> None:
    target = LocalTarget()
    scripts = [Script("fine", "echo fine"), Script("cut", "sleep 50", 0.2), Script("stray", "setsid sleep 4 & echo left")]
    before, children = os.listdir("/proc/self/fd"), psutil.Process().children()  # noqa: PTH208
    outputs = target.batch(scripts)
    assert outputs["cut"].status is None and outputs["cut"].stderr == "no end within 0.2 s"
    assert os.listdir("/proc/self/fd") == before  # noqa: PTH208
    assert psutil.Process().children() == children


@pytest.mark.filterwarnings("ignore:subprocess .* is still running:ResourceWarning")
def test_a_script_that_nothing_can_end_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    killed = os.killpg
    monkeypatch.setattr("lupin_cli.target.side_by_side.KILL_AFTER_S", 0.2)
    monkeypatch.setattr(os, "killpg", lambda *_: None)  # as one that waits for a disk in the kernel
    before = psutil.Process().children()
    start = time.monotonic()
    outputs = LocalTarget().batch([Script("dead", "echo begun; exec sleep 60", 0.2), Script("fine", "echo fine")])
    assert time.monotonic() - start < 20
    assert outputs["dead"].status is None and outputs["dead"].stdout == "begun\n" and outputs["fine"].stdout == "fine\n"
    (left,) = set(psutil.Process().children()) - set(before)
    killed(left.pid, signal.SIGKILL)
    left.wait(10)
