"""`lupin replay` and `lupin report` as a person calls them: on good files, on bad ones, and interrupted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lupin_runtime import graph
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.writer import RecordingWriter

BOOL_TRUE = b"\x00\x01\x00\x00\x01"


def lupin(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", *arguments],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.fixture
def drive(tmp_path) -> Path:
    """A short recording: an e-stop over three seconds and a little drive."""
    from geometry_msgs.msg import TransformStamped
    from rclpy.serialization import serialize_message
    from tf2_msgs.msg import TFMessage

    path = tmp_path / "drive.mcap"
    writer = RecordingWriter(path)
    stop, tf = (writer.add_channel(row.name, row.type, schema_text(row.type), row.qos) for row in (graph.ESTOP_STATE, graph.TF))
    for i in range(30):
        writer.write(stop, BOOL_TRUE, i * 100_000_000, i)
        step = TransformStamped(child_frame_id="base_link")
        step.header.frame_id = "odom"
        step.header.stamp.sec, step.header.stamp.nanosec = divmod(i * 100_000_000, 1_000_000_000)
        step.transform.translation.x = i * 0.03
        writer.write(tf, bytes(serialize_message(TFMessage(transforms=[step]))), i * 100_000_000 + 1, i)
    writer.finish()
    return path


def test_info_says_what_is_recorded(drive):
    done = lupin("replay", str(drive), "--info", "--json")
    assert done.returncode == 0, done.stderr
    (summary,) = json.loads(done.stdout)
    assert summary["messages"] == 60
    assert {t["topic"]: t["messages"] for t in summary["topics"]} == {"/e_stop_state": 30, "/tf": 30}
    assert "/e_stop_state" in lupin("replay", str(drive), "--info").stdout


@pytest.mark.graph
def test_a_replay_plays_to_its_end_and_says_how_to_join(drive):
    done = lupin("replay", str(drive), "--rate", "20")
    assert done.returncode == 0, done.stderr
    assert "ROS_DOMAIN_ID=" in done.stdout
    assert "FASTRTPS_DEFAULT_PROFILES_FILE=" in done.stdout
    assert "60 messages" in done.stderr


@pytest.mark.graph
def test_an_interrupted_replay_leaves_no_process_and_says_130(drive):
    command = [sys.executable, "-m", "lupin_cli.app", "replay", str(drive), "--loop", "--rate", "0.5"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        for line in process.stdout:
            if "export" in line:
                break
        profile = next(word for word in line.split() if word.startswith("FASTRTPS")).split("=", 1)[1]
        assert Path(profile).exists()
        deadline = time.monotonic() + 20.0
        while not (players := children(process.pid)):
            assert time.monotonic() < deadline, "no player was started"
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        process.wait(30)
    finally:
        process.kill()
        process.wait(10)
        process.stdout.close()
    assert process.returncode == 130
    assert not Path(profile).exists()
    assert not any(Path(f"/proc/{pid}").exists() for pid in players)


def children(pid: int) -> list[int]:
    import psutil

    return [child.pid for child in psutil.Process(pid).children(recursive=True)]


def test_a_report_of_a_lone_recording(drive, tmp_path):
    done = lupin("report", str(drive), "--out", str(tmp_path / "out"), "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["figures"]["distance_m"] == pytest.approx(0.87, abs=0.04)
    assert (tmp_path / "out" / "report.html").exists()
    words = lupin("report", str(drive))
    assert "There was no map" in words.stdout
    assert words.stdout.rstrip().endswith("report.html")


def test_the_page_of_a_recording_is_built_where_there_is_none(drive):
    done = lupin("replay", str(drive), "--page")
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).read_text().startswith("<!doctype html>")


@pytest.mark.parametrize("verb", ["replay", "report"])
@pytest.mark.parametrize(
    ("content", "status", "words"),
    [
        (b"", 1, "is no MCAP recording: it is empty"),
        (b"not a recording", 1, "is no MCAP recording"),
        (None, 2, "there is no such file, and no run was recorded yet"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_sentence(tmp_path, verb, content, status, words):
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    done = lupin(verb, str(path), XDG_STATE_HOME=str(tmp_path / "state"))
    assert done.returncode == status
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rate", "0"], "is no pace"),
        (["--rate", "nan"], "is no pace"),
        (["--topics", "/nope"], "not recorded: /nope"),
        (["--json"], "--json goes with --info"),
    ],
)
def test_usage_errors_say_what_to_type(drive, arguments, words):
    done = lupin("replay", str(drive), *arguments)
    assert done.returncode == 2
    assert words in done.stderr


def test_a_file_cut_short_is_named(drive):
    content = drive.read_bytes()
    drive.write_bytes(content[: len(content) // 4])
    done = lupin("replay", str(drive), "--info")
    assert done.returncode == 0
    assert "cut off in the middle of a record" in " ".join(done.stdout.split())
