"""`lupin replay` and `lupin report` as a person calls them: on good files, on bad ones, and interrupted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_runtime import graph
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.writer import RecordingWriter
from tests.support.rosbag2_folders import write_metadata
from tests.support.waiting import wait_until

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
def drive(tmp_path: Path) -> Path:
    """Return a recording of three seconds: an e-stop, and a short drive."""
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


def test_replay_info_lists_recorded_topics(drive: Path) -> None:
    done = lupin("replay", str(drive), "--info", "--json")
    assert done.returncode == 0, done.stderr
    (summary,) = json.loads(done.stdout)
    assert summary["messages"] == 60
    assert {t["topic"]: t["messages"] for t in summary["topics"]} == {"/e_stop_state": 30, "/tf": 30}
    assert "/e_stop_state" in lupin("replay", str(drive), "--info").stdout


@pytest.mark.graph
def test_replay_plays_to_its_end_and_prints_how_to_join(drive: Path) -> None:
    done = lupin("replay", str(drive), "--rate", "20")
    assert done.returncode == 0, done.stderr
    assert "ROS_DOMAIN_ID=" in done.stdout
    assert "FASTRTPS_DEFAULT_PROFILES_FILE=" in done.stdout
    assert "60 messages" in done.stderr


@pytest.mark.graph
def test_interrupted_replay_leaves_no_process_and_exits_130(drive: Path) -> None:
    command = [sys.executable, "-m", "lupin_cli.app", "replay", str(drive), "--loop", "--rate", "0.5"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if "export" in line:
                break
        profile = next(word for word in line.split() if word.startswith("FASTRTPS")).split("=", 1)[1]
        assert Path(profile).exists()
        players = wait_until(lambda: children(process.pid), "a player")
        process.send_signal(signal.SIGINT)
        process.wait(60)
    finally:
        process.kill()
        process.wait(60)
        process.stdout.close()
    assert process.returncode == 130
    assert not Path(profile).exists()
    assert not any(Path(f"/proc/{pid}").exists() for pid in players)


def children(pid: int) -> list[int]:
    import psutil

    return [child.pid for child in psutil.Process(pid).children(recursive=True)]


def test_report_of_a_single_recording(drive: Path, tmp_path: Path) -> None:
    done = lupin("report", str(drive), "--out", str(tmp_path / "out"), "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["figures"]["distance_m"] == pytest.approx(0.87, abs=0.04)
    assert (tmp_path / "out" / "report.html").exists()
    words = lupin("report", str(drive))
    assert "No map was recorded" in words.stdout
    assert words.stdout.rstrip().endswith("report.html")


def test_report_of_two_runs_compares_them(drive: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(drive.read_bytes())
    done = lupin("report", str(drive), str(other), "--json", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["schema"] == "lupin-comparison/1"
    assert [content[side]["id"] for side in ("a", "b")] == ["drive-report", "other-report"]
    words = lupin("report", str(drive), str(other))
    assert words.returncode == 0, words.stderr
    assert "Distance driven" in words.stdout
    page = Path(words.stdout.rstrip().splitlines()[-1])
    assert page == tmp_path / "other-report" / "report" / "comparison-with-drive-report.html"
    assert page.read_text().startswith("<!doctype html>")
    assert (tmp_path / "out" / page.name).exists()


@pytest.mark.parametrize(
    ("count", "words"), [(2, "are the same run, drive-report"), (3, "compares two runs, and 3 were named")]
)
def test_comparison_of_other_than_two_runs_is_refused(drive: Path, count: int, words: str) -> None:
    done = lupin("report", *[str(drive)] * count)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stdout == ""


def test_replay_page_builds_a_missing_report(drive: Path) -> None:
    done = lupin("replay", str(drive), "--page")
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).read_text().startswith("<!doctype html>")


@pytest.mark.parametrize("verb", ["replay", "report"])
@pytest.mark.parametrize(
    ("content", "status", "words"),
    [
        (b"", 1, "is not an MCAP recording: it is empty"),
        (b"not a recording", 1, "is not an MCAP recording"),
        (None, 2, "there is no such file, and no run was recorded yet"),
    ],
)
def test_unreadable_recording_is_refused_without_traceback(
    tmp_path: Path, verb: str, content: bytes | None, status: int, words: str
) -> None:
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
        (["--rate", "0"], "is not a valid speed"),
        (["--rate", "nan"], "is not a valid speed"),
        (["--topics", "/nope"], "not recorded: /nope"),
        (["--json"], "--json needs --info"),
    ],
)
def test_replay_usage_errors_name_the_problem(drive: Path, arguments: list[str], words: str) -> None:
    done = lupin("replay", str(drive), *arguments)
    assert done.returncode == 2
    assert words in done.stderr


def test_truncated_recording_is_reported(drive: Path) -> None:
    content = drive.read_bytes()
    drive.write_bytes(content[: len(content) // 4])
    done = lupin("replay", str(drive), "--info")
    assert done.returncode == 0
    assert "truncated in the middle of a record" in " ".join(done.stdout.split())


def test_folder_of_rosbag2_is_listed_and_reported(drive: Path) -> None:
    garden = drive.parent / "garden"
    garden.mkdir()
    drive.rename(garden / "garden_0.mcap")
    write_metadata(garden, ["garden_0.mcap", "garden_1.mcap"])
    done = lupin("replay", str(garden), "--info", "--json")
    assert done.returncode == 0, done.stderr
    assert [summary["messages"] for summary in json.loads(done.stdout)] == [60]
    assert "garden_1.mcap: no such file, but metadata.yaml lists it" in done.stderr
    report = lupin("report", str(garden))
    assert report.returncode == 0, report.stderr
    assert "garden_1.mcap: no such file" in (garden / "report" / "report.json").read_text()
