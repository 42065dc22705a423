"""Maps from logs, by function and by command; sessions from which mapping resumes."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from typer.testing import CliRunner

from lupin_cli.commands.map import app
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.carmen import parse_carmen
from lupin_runtime.slam.g2o import read_g2o
from lupin_runtime.slam.map_io import load_map
from lupin_runtime.slam.mapper import Mapper, MapperSettings
from lupin_runtime.slam.offline import BuiltMap, NothingToMap, OfflineScan, build_map, no_return_limit_m, scans_from_carmen
from lupin_runtime.slam.scan import Beams
from lupin_runtime.slam.session import load_session, save_session
from tests.support import slam_worlds
from tests.support.mapping_run import MappingRun
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.support.slam_worlds import Log


@pytest.fixture(scope="module")
def office() -> Log:
    """A floor with a loop of 100 m: 180 degrees of laser, a scan in three seconds, people, slips, drift of tens of meters."""
    drift = slam_worlds.Drift(travel_scale=0.03, turn_scale=0.05, turn_per_m=0.02, travel_noise=0.15, turn_noise=0.08)
    disturbances = slam_worlds.Disturbances(people=3, wrong_readings=0.01, missing_readings=0.04, slip=0.0004)
    log = slam_worlds.office_log(2, drift=drift, disturbances=disturbances)
    result: Log = slam_worlds.Log(log.stamps[:340], log.truth[:340], log.odom[:340], log.ranges[:340], log.angles)
    return result


@pytest.fixture(scope="module")
def built(office: Log, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, int], str]:
    """Build the map of that log, with two broken lines in it, by `lupin map build`: the folder and the JSON."""
    folder = tmp_path_factory.mktemp("office")
    lines = slam_worlds.carmen_text(office).splitlines()
    lines.insert(50, "FLASER 180 1.0 2.0")
    lines.append(lines[-1][:200])
    (folder / "office.log").write_text("\n".join(lines) + "\n")
    result = CliRunner().invoke(app, ["build", str(folder / "office.log"), "--out", str(folder / "map"), "--json"])
    assert result.exit_code == 0, result.stderr
    return folder / "map", json.loads(result.stdout), result.stderr


def test_log_with_faults_becomes_a_consistent_map(built: tuple[Path, dict[str, Any], str], office: Log) -> None:
    folder, result, _ = built
    drift, _ = slam_worlds.aligned_errors(office.odom, office.truth)
    assert drift.max() > 20.0
    rows = np.loadtxt(folder / "trajectory.tum")
    poses = np.column_stack((rows[:, 1:3], 2.0 * np.arctan2(rows[:, 6], rows[:, 7])))
    place, yaw = slam_worlds.aligned_errors(poses, office.truth)
    assert np.sqrt((place**2).mean()) < 0.25
    assert np.degrees(np.sqrt((yaw**2).mean())) < 1.0
    assert result["closures"] > 20
    assert 40.0 < result["map"]["width"] * 0.05 < 80.0  # 44 m of floor, and invalid readings beyond its walls


def test_every_scan_has_a_pose_with_its_own_stamp(built: tuple[Path, dict[str, Any], str], office: Log) -> None:
    stamps = [line.split()[0] for line in (built[0] / "trajectory.tum").read_text().splitlines()]
    assert stamps == [f"{976052857.337534 + stamp:.6f}" for stamp in office.stamps]


def test_broken_lines_are_named_on_standard_error(built: tuple[Path, dict[str, Any], str]) -> None:
    _, result, errors = built
    assert "line 51: FLASER" in errors
    assert result["problems"] == 2


def test_written_graph_is_at_its_optimum(built: tuple[Path, dict[str, Any], str]) -> None:
    graph = read_g2o(built[0] / "graph.g2o")
    result = CliRunner().invoke(app, ["optimize", str(built[0] / "graph.g2o"), "--json"])
    found = json.loads(result.stdout)
    assert result.exit_code == 0 and found["vertices"] == len(graph.poses) and found["edges"] == len(graph.edges)
    assert found["chi2"] <= found["chi2_before"]


def test_written_map_has_walls_and_rooms(built: tuple[Path, dict[str, Any], str]) -> None:
    grid = load_map(built[0] / "map.yaml")
    assert (grid.cells == 100).sum() > 3000
    assert (grid.cells == 0).sum() * 0.05**2 > 300.0


def test_optimize_writes_the_solved_graph(built: tuple[Path, dict[str, Any], str], tmp_path: Path) -> None:
    graph = read_g2o(built[0] / "graph.g2o")
    poor = tmp_path / "poor.g2o"
    text = (built[0] / "graph.g2o").read_text().splitlines()
    poor.write_text("\n".join(f"VERTEX_SE2 {line.split()[1]} 0 0 0" if line.startswith("VERTEX") else line for line in text))
    result = CliRunner().invoke(app, ["optimize", str(poor), "--out", str(tmp_path / "good.g2o"), "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    reference = json.loads(CliRunner().invoke(app, ["optimize", str(built[0] / "graph.g2o"), "--json"]).stdout)
    assert found["chi2"] == pytest.approx(reference["chi2"], rel=1e-4)
    good = read_g2o(tmp_path / "good.g2o")
    assert len(good.edges) == len(graph.edges) and np.abs(good.poses).max() > 10.0


def test_optimize_names_vertices_that_no_edges_join(tmp_path: Path) -> None:
    information = "1 0 0 1 0 1"
    lines = [f"EDGE_SE2 {k} {k + 1} 1 0 0 {information}" for k in (*range(10, 20), *range(40, 52))]
    (tmp_path / "edges.g2o").write_text("\n".join(lines))
    result = CliRunner().invoke(app, ["optimize", str(tmp_path / "edges.g2o"), "--json"])
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert (found["poses_from"], found["vertices"], found["chi2"]) == ("edges", 24, pytest.approx(0.0, abs=1e-12))
    assert found["disconnected"] == list(range(10, 21))
    assert "no edges join 11 of 24 vertices to vertex 40" in result.stderr and "10, 11, 12" in result.stderr

    (tmp_path / "alone.g2o").write_text(
        f"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_SE2 7 5 5 0\nEDGE_SE2 0 1 1 0 0 {information}\n"
    )
    result = CliRunner().invoke(app, ["optimize", str(tmp_path / "alone.g2o")])
    assert result.exit_code == 0 and "no edges join 1 of 3 vertices to vertex 0" in result.stderr
    assert "arbitrary: 7\n" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["build", "{}/none.log", "--out", "{}/o"], 2, "no such file"),
        (["build", "{}/bad.log", "--out", "{}/o"], 2, "no FLASER"),
        (["build", "{}/bad.mcap", "--out", "{}/o"], 2, "bad.mcap"),
        (["build", "{}/blind.log", "--out", "{}/o"], 1, "none of 20 scans"),
        (["build", "{}/blind.log", "--out", "{}/bad.log"], 2, "is a file"),
        (["build", "{}/blind.log"], 2, "--out"),
        (["optimize", "{}/none.g2o"], 2, "no such file"),
        (["optimize", "{}/bad.log"], 2, "bad.log:1: expected one of VERTEX_SE2"),
    ],
)
def test_failures_have_their_message_and_exit_code(tmp_path: Path, arguments: list[str], code: int, says: str) -> None:
    (tmp_path / "bad.log").write_text("nothing of use\n")
    (tmp_path / "bad.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\0" * 40)
    blind = " ".join(["81.83"] * 180)
    (tmp_path / "blind.log").write_text("".join(f"FLASER 180 {blind} {k} 0 0 {k} 0 0 {k}.0 host 0\n" for k in range(20)))
    result = CliRunner().invoke(app, [a.format(tmp_path) for a in arguments])
    assert result.exit_code == code
    assert says in result.stderr.replace("\n", "")
    assert not (tmp_path / "o" / "map.yaml").exists()


def test_laser_ceiling_is_found_in_its_readings() -> None:
    rng = np.random.default_rng(0)
    free = [np.round(rng.uniform(1, 30, 180), 2) for _ in range(20)]
    assert math.isinf(no_return_limit_m(free))
    assert no_return_limit_m([np.where(rng.random(180) < 0.1, 81.83, r) for r in free]) == 81.83
    assert math.isinf(no_return_limit_m([np.full(180, np.nan)]))
    # Three "no return" codes of one laser, and a few invalid readings beyond them.
    codes = [np.where(rng.random(180) < 0.2, rng.choice([8.183, 8.187, 8.191], 180), np.minimum(r / 4.0, 8.0)) for r in free]
    codes[3][:5] = 55.0
    assert no_return_limit_m(codes) == 8.183


def _mapped(text: str) -> tuple[BuiltMap, np.ndarray]:
    scans = scans_from_carmen(parse_carmen(text.splitlines()))
    result = build_map(scans, refine=False)
    return result, np.array([[pose.x, pose.y, pose.yaw] for pose in result.poses])


def _restamped(lines: list[str], stamps: list[str]) -> str:
    return "\n".join(" ".join([*line.split()[:-3], stamp, *line.split()[-2:]]) for line, stamp in zip(lines, stamps))


@pytest.fixture(scope="module")
def short(office: Log) -> tuple[Log, list[str]]:
    """The first 120 scans of that log, and their lines."""
    log = slam_worlds.Log(office.stamps[:120], office.truth[:120], office.odom[:120], office.ranges[:120], office.angles)
    return log, [line for line in slam_worlds.carmen_text(log).splitlines() if line.startswith("FLASER")]


@pytest.mark.parametrize("trouble", ["rounded", "swapped stamps", "swapped lines"])
def test_unordered_stamps_and_lines_change_no_pose(short: tuple[Log, list[str]], trouble: str) -> None:
    log, lines = short
    stamps = [line.split()[-3] for line in lines]
    order = np.arange(len(lines))
    if trouble == "rounded":
        stamps = [f"{float(stamp):.5e}" for stamp in stamps]
    else:
        order[1:-1:4], order[2::4] = order[2::4].copy(), order[1:-1:4].copy()
        stamps = stamps if trouble == "swapped lines" else [stamps[k] for k in order]
    if trouble == "swapped lines":
        result, poses = _mapped("\n".join(lines[k] for k in order))
        assert result.stamps == [stamps[k] for k in order]
    else:
        result, poses = _mapped(_restamped(lines, stamps))
        assert result.stamps == stamps
    truth = log.truth[order] if trouble == "swapped lines" else log.truth
    assert result.odometry_jumps == 0
    assert np.sqrt((slam_worlds.aligned_errors(poses, truth)[0] ** 2).mean()) < 0.3


def test_odometry_reset_costs_one_motion_not_the_map(short: tuple[Log, list[str]]) -> None:
    log, _ = short
    odom = log.odom.copy()
    odom[60:, :2] += (-40.0, 30.0)
    result, poses = _mapped(slam_worlds.carmen_text(slam_worlds.Log(log.stamps, log.truth, odom, log.ranges, log.angles)))
    assert result.odometry_jumps == 1
    assert np.sqrt((slam_worlds.aligned_errors(poses, log.truth)[0] ** 2).mean()) < 0.3


def test_corridor_of_equal_doors_is_not_closed_at_the_next_door() -> None:
    """A false closure would be off by one door, 5 m, and be confirmed at every further door."""
    drift = slam_worlds.Drift(travel_scale=0.03, turn_scale=0.05, turn_per_m=0.012, travel_noise=0.12, turn_noise=0.06)
    disturbances = slam_worlds.Disturbances(people=2, wrong_readings=0.005, missing_readings=0.03)
    log = slam_worlds.corridor_log(0, drift=drift, disturbances=disturbances)
    assert slam_worlds.aligned_errors(log.odom, log.truth)[0].max() > 25.0
    result, poses = _mapped(slam_worlds.carmen_text(log))
    assert result.closures > 10
    place, _ = slam_worlds.aligned_errors(poses, log.truth)
    assert place.max() < 1.0


def test_scans_before_the_first_usable_one_get_poses_too(greenhouse_log: Log) -> None:
    beams = Beams(float(greenhouse_log.angles[0]), float(greenhouse_log.angles[1] - greenhouse_log.angles[0]), 360)
    scans = [
        OfflineScan(
            str(k), k * 0.1, Pose2(*greenhouse_log.odom[k]), greenhouse_log.ranges[k] * (np.nan if k < 20 else 1.0), beams
        )
        for k in range(120)
    ]
    result = build_map(scans, settings=MapperSettings())
    assert len(result.poses) == 120 and result.unusable == 20
    estimate = np.array([[p.x, p.y, p.yaw] for p in result.poses])
    assert slam_worlds.aligned_errors(estimate, greenhouse_log.truth[:120])[0].max() < 0.05
    with pytest.raises(NothingToMap):
        build_map(scans[:20])


# -- sessions --------------------------------------------------------------------------------------------------------------


def test_mapper_resumes_from_a_saved_session(greenhouse_log: Log, tmp_path: Path) -> None:
    first = MappingRun(greenhouse_log).process(0, 400)
    x, y, yaw = first.results[-1].pose
    at = Pose2(x, y, yaw) @ Pose2(*greenhouse_log.odom[399]).inverse()
    save_session(tmp_path / "s.posegraph", first.mapper.graph, np.array([at.x, at.y, at.yaw]), math.radians(1.0))
    kept = load_session(tmp_path / "s.posegraph")
    assert len(kept.graph) == len(first.mapper.graph) and len(kept.graph.edges) == len(first.mapper.graph.edges)

    second = MappingRun(greenhouse_log)
    pose = Pose2(*kept.map_from_odom) @ Pose2(*greenhouse_log.odom[420])
    second.mapper = Mapper.resumed(None, kept.graph, np.array([pose.x, pose.y, pose.yaw]))
    before = first.mapper.grid()
    after = second.mapper.grid()
    same = (
        (present(before).cells == present(after).cells).mean()
        if present(before).cells.shape == present(after).cells.shape
        else 0.0
    )
    assert same > 0.97  # the saved points are rounded to single precision
    second.process(420, 700)
    start = Pose2(*greenhouse_log.truth[0]).inverse()
    for k, result in zip(range(420, 700), second.results):
        truth = start @ Pose2(*greenhouse_log.truth[k])
        assert math.hypot(result.pose[0] - truth.x, result.pose[1] - truth.y) < 0.06


@pytest.mark.parametrize(
    "spoil", [lambda b: b[: len(b) // 2], lambda _b: b"", lambda b: b"PK" + b[2:50], lambda _b: bytes(200)]
)
def test_corrupt_session_is_refused(greenhouse_log: Log, tmp_path: Path, spoil: Callable[..., Any]) -> None:
    path = tmp_path / "s.posegraph"
    save_session(path, MappingRun(greenhouse_log).process(0, 30).mapper.graph, np.zeros(3), 0.01)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(MalformedFile, match=r"s\.posegraph"):
        load_session(path)


def test_vertex_that_a_graph_leaves_free_is_named_by_its_id(tmp_path: Path) -> None:
    file = tmp_path / "g.g2o"
    file.write_text("EDGE_SE2 10 20 1 0 0 1 0 0 1 0 1\nEDGE_SE2 20 30 1 0 0 1 0 0 1 0 0\n")
    result = CliRunner().invoke(app, ["optimize", str(file)])
    assert result.exit_code == 1
    assert f"{file}: the edges do not determine vertex 30: its angle is free; add an edge" in result.stderr
    file.write_text(file.read_text() + "EDGE_SE2 10 30 9 9 0.2 0 0 0 0 0 5\n")
    result = CliRunner().invoke(app, ["optimize", str(file), "--json"])
    assert (result.exit_code, json.loads(result.stdout)["chi2"]) == (0, pytest.approx(0.0, abs=1e-12))
