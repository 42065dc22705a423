"""Files of maps, graphs, logs and trajectories: round trips, and errors that name file and line."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam.carmen import parse_carmen, read_carmen
from lupin_runtime.slam.g2o import GraphFile, read_g2o, write_g2o
from lupin_runtime.slam.map_io import load_map, save_map
from lupin_runtime.slam.pose_graph import Edges
from lupin_runtime.slam.tum import format_tum, write_tum

GOOD = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
TRINARY = st.sampled_from([-1, 0, 100])


def grid(cells: list[list[int]] | np.ndarray, resolution: float = 0.05, x: float = -1.25, y: float = 0.5) -> GridMap:
    return GridMap(np.array(cells, np.int8), resolution, x, y)


# -- maps ----------------------------------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(cells=hnp.arrays(np.int8, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=TRINARY))
def test_trinary_map_round_trips_cell_by_cell(cells: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("map") / "m.yaml"
    save_map(path, grid(cells))
    back = load_map(path)
    np.testing.assert_array_equal(back.cells, cells)
    assert (back.resolution_m, back.origin_x, back.origin_y) == (0.05, -1.25, 0.5)


@settings(max_examples=20)
@given(cells=hnp.arrays(np.int8, (7, 5), elements=st.integers(-1, 100)))
def test_raw_mode_keeps_every_grade(cells: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("map") / "m.yaml"
    save_map(path, grid(cells), "raw")
    np.testing.assert_array_equal(load_map(path).cells, cells)


def test_scale_mode_keeps_grades_and_has_no_unknown(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    save_map(path, grid([[0, 25, 50], [75, 99, 100]]), "scale")
    np.testing.assert_array_equal(load_map(path).cells, [[0, 25, 50], [75, 99, 100]])
    with pytest.raises(ValueError, match="unknown"):
        save_map(path, grid([[0, -1]]), "scale")


def test_slam_toolbox_map_is_read_with_its_thresholds(tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(
        b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n3 2\n255\n" + bytes([0, 254, 205, 254, 254, 0])
    )
    (tmp_path / "m.yaml").write_text(GOOD.replace("[0, 0, 0]", "[-1, -2, 0]") + "mode: trinary\n")
    read = load_map(tmp_path / "m.yaml")
    np.testing.assert_array_equal(read.cells, [[0, 0, 100], [100, 0, -1]])
    assert (read.origin_x, read.origin_y) == (-1.0, -2.0)


def test_negate_inverts_black_and_white(tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(b"P2 2 1 255\n255 0\n")
    (tmp_path / "m.yaml").write_text(
        "image: m.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 1\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    np.testing.assert_array_equal(load_map(tmp_path / "m.yaml").cells, [[100, 0]])


def test_turned_origin_is_resampled_onto_the_frame_axes(tmp_path: Path) -> None:
    cells = np.zeros((20, 40), np.int8)
    cells[5, 30] = 100
    save_map(tmp_path / "m.yaml", grid(cells, 0.1, 1.0, 2.0))
    text = (tmp_path / "m.yaml").read_text().replace("2.0, 0]", f"2.0, {math.pi / 2}]")
    (tmp_path / "m.yaml").write_text(text)
    turned = load_map(tmp_path / "m.yaml")
    # The cell's center, (3.05, 0.55) from the corner, turned by 90 degrees.
    row, column = turned.cell_of(1.0 - 0.55, 2.0 + 3.05)
    assert turned.cells[row, column] == 100
    assert (turned.cells == 100).sum() == 1
    assert (turned.height, turned.width) == (40, 20)


def test_transparent_png_cells_are_unknown(tmp_path: Path) -> None:
    gray = np.array([[0, 254, 205], [254, 254, 0]], np.uint8)
    cv2.imwrite(str(tmp_path / "gray.png"), gray)
    cv2.imwrite(str(tmp_path / "deep.png"), gray.astype(np.uint16) * 257)
    clear = np.dstack((gray, gray, gray, np.array([[255, 255, 255], [255, 0, 255]], np.uint8)))
    cv2.imwrite(str(tmp_path / "clear.png"), clear)
    for name, middle in (("gray", 0), ("deep", 0), ("clear", -1)):
        (tmp_path / "m.yaml").write_text(GOOD.replace("m.pgm", f"{name}.png"))
        np.testing.assert_array_equal(load_map(tmp_path / "m.yaml").cells, [[0, middle, 100], [100, 0, -1]])
    (tmp_path / "clear.png").write_bytes(b"\x89PNG nothing")
    with pytest.raises(MalformedFile, match=r"clear.png: expected PNG"):
        load_map(tmp_path / "m.yaml")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("resolution: 0.05", "resolution: zero", r"m.yaml:2: resolution: expected a number"),
        ("resolution: 0.05", "resolution: -1", r"m.yaml:2: resolution"),
        ("resolution: 0.05", "resolution: .nan", r"m.yaml:2: resolution"),
        ("resolution: 0.05\n", "", r"m.yaml: the key 'resolution' is missing"),
        ("[0, 0, 0]", "[0, 0]", r"m.yaml:3: origin: expected 3 numbers"),
        ("[0, 0, 0]", "[0, 0", r"m.yaml:4"),
        ("negate: 0", "negate: 7", r"m.yaml:4: negate"),
        ("free_thresh: 0.196", "free_thresh: 0.9", r"m.yaml:6: free_thresh 0.9 must be below"),
        ("image: m.pgm", "image: [1]", r"m.yaml:1: image"),
        ("image: m.pgm", "image: other.pgm", r"other.pgm does not exist"),
        (GOOD, "- 1\n- 2\n", r"m.yaml:1: expected keys"),
        (GOOD, "a: b: c\n", r"m.yaml:1"),
    ],
)
def test_malformed_map_yaml_is_refused_by_line(tmp_path: Path, old: str, new: str, says: str) -> None:
    (tmp_path / "m.pgm").write_bytes(b"P5 1 1 255\n\0")
    (tmp_path / "m.yaml").write_text(GOOD.replace(old, new))
    with pytest.raises(MalformedFile, match=says):
        load_map(tmp_path / "m.yaml")


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"GIF89a", r"m.pgm:1: expected PNG, .* found b'GIF8'.* convert it"),
        (b"P5 3 3 255\n\0\0", r"expected 9 pixels, found 2"),
        (b"P5\n3 x 255\n", r"m.pgm:2: expected width"),
        (b"P5 0 3 255\n", r"are not a map"),
        (b"P2 1 2 255\n3 q\n", r"a pixel is not a number"),
    ],
)
def test_malformed_image_is_refused(tmp_path: Path, data: bytes, says: str) -> None:
    (tmp_path / "m.pgm").write_bytes(data)
    (tmp_path / "m.yaml").write_text(GOOD)
    with pytest.raises(MalformedFile, match=says):
        load_map(tmp_path / "m.yaml")


# -- graphs --------------------------------------------------------------------------------------------------------------


def test_graph_round_trips_in_full_precision(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 3, 3))
    edges = Edges(
        np.array([0, 1, 2, 0]), np.array([1, 2, 3, 3]), rng.normal(size=(4, 3)), root @ root.transpose(0, 2, 1) + np.eye(3)
    )
    graph = GraphFile(np.array([10, 7, 3, 99]), rng.normal(size=(4, 3)), edges, np.array([1]))
    write_g2o(tmp_path / "g.g2o", graph)
    back = read_g2o(tmp_path / "g.g2o")
    np.testing.assert_array_equal(back.ids, graph.ids)
    np.testing.assert_array_equal(back.poses, graph.poses)
    np.testing.assert_array_equal(back.edges.motion, edges.motion)
    np.testing.assert_array_equal(back.edges.tail, edges.tail)
    # Only the upper triangle is written: an asymmetry in the last bit is not kept.
    np.testing.assert_allclose(back.edges.information, edges.information, rtol=1e-15)
    assert back.fixed.tolist() == [1]


def test_toro_information_matrix_order_is_read(tmp_path: Path) -> None:
    (tmp_path / "g").write_text("VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 10 1 20 30 2 3\n")
    np.testing.assert_array_equal(read_g2o(tmp_path / "g").edges.information[0], [[10, 1, 2], [1, 20, 3], [2, 3, 30]])


def test_graph_with_edges_alone_gets_its_poses_from_them(tmp_path: Path) -> None:
    """Against the direction of one edge, and with a part that no edge joins to the first."""
    info = "1 0 0 1 0 1"
    (tmp_path / "g").write_text(
        f"EDGE_SE2 4 9 2 0 {math.pi / 2} {info}\nEDGE_SE2 2 9 0 1 0 {info}\nEDGE_SE2 70 80 0 3 0 {info}\nFIX 4\n"
    )
    read = read_g2o(tmp_path / "g")
    assert (read.ids.tolist(), read.fixed.tolist(), read.has_vertices) == ([2, 4, 9, 70, 80], [1], False)
    expected = np.array([[3, 0, math.pi / 2], [0, 0, 0], [2, 0, math.pi / 2], [0, 0, 0], [0, 3, 0]])
    np.testing.assert_allclose(read.poses, expected, atol=1e-12)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
def test_graph_is_read_as_g2o_reads_it(tmp_path: Path, end: str) -> None:
    """Any line end and white space; what follows the last field is passed over; exponents; semidefinite matrices."""
    lines = ["# saved elsewhere", "", "VERTEX_SE2\t0 0 0 0 1234.5", "VERTEX_SE2 1 1e0 +.5 -0. # here", "FIX 0"]
    lines += ["EDGE_SE2 0 1 1 5e-1 0 100 0 0 100 0 0 extra"]
    (tmp_path / "g").write_bytes(end.join(lines).encode())
    read = read_g2o(tmp_path / "g")
    np.testing.assert_array_equal(read.poses, [[0, 0, 0], [1, 0.5, 0]])
    np.testing.assert_array_equal(read.edges.information[0], np.diag([100, 100, 0]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("VERTEX_SE2 0 0 0\n", r":1: VERTEX_SE2: expected 4 fields"),
        ("VERTEX_SE2 0 0 0 nan\n", r":1: VERTEX_SE2: expected finite"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0\n", r":2: VERTEX_SE2: vertex 0 is defined twice"),
        ("VERTEX_SE2 0 0 0 0\n\nEDGE_SE2 0 5 1 0 0 1 0 0 1 0 1\n", r":3: the edge names vertex 5"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 -1 0 1\n", r":3: EDGE_SE2: .*positive definite"),
        ("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 0 1 0 0 1 0 0 1 0 1\n", r":2: the edge joins vertex 0 with itself"),
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", r":1: expected one of VERTEX_SE2"),
        ("VERTEX_SE2 0 0,5 0,0 0,0\r\n", r":1: VERTEX_SE2: decimal commas: expected 0.5, found 0,5; save"),
        ("VERTEX_SE2 0 1_0 0 0\n", r":1: VERTEX_SE2: expected a number, found '1_0'"),
        ("VERTEX_SE2 0 0x1 0 0\n", r":1: VERTEX_SE2: expected a number, found '0x1'"),
        ("VERTEX_SE2 0 -inf 0 0\n", r":1: VERTEX_SE2: expected finite"),
        ("VERTEX_SE2 0.0 0 0 0\n", r":1: VERTEX_SE2: expected a vertex id, which is a whole number, found '0.0'"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_XY 1 2 3\n", r":2: expected one of .*, found 'VERTEX_XY', a landmark or an edge to one"),
        ("VERTEX_SE2 0 0 0 0\nEDGE_SE2_XY 0 1 1 1 5 0 5\n", r":2: .*found 'EDGE_SE2_XY', a landmark or an edge to one"),
        ("EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1\n", r":1: .*found 'EDGE_SE3:QUAT', of a 3-D graph"),
        ("EDGE_PRIOR_SE2 0 0 0 0 1 0 0 1 0 1\n", r":1: .*found 'EDGE_PRIOR_SE2', a prior of a single pose"),
        ("# nothing\n", r"neither a VERTEX_SE2 nor an EDGE_SE2 line"),
        ("EDGE_SE2 0 5 1 0 0 1 0 0 1 0 1\nFIX 4\n", r":2: FIX names vertex 4, which no edge names"),
        ("VERTEX_SE2 0 0 0 0\nFIX 4\n", r":2: FIX names vertex 4"),
        ("VERTEX_SE2 9223372036854775808 0 0 0\n", r":1: VERTEX_SE2: 9223372036854775808 is not a vertex id"),
        ("VERTEX_SE2 0 1e300 0 0\n", r":1: VERTEX_SE2: expected finite numbers up to"),
    ],
)
def test_malformed_graph_is_refused_by_line(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "g.g2o").write_text(text)
    with pytest.raises(MalformedFile, match=says):
        read_g2o(tmp_path / "g.g2o")


# -- logs ----------------------------------------------------------------------------------------------------------------


def flaser(count: int, x: float, mount: float = 0.0, stamp: str = "976052857.337534", reading: str = "1.00") -> str:
    readings = " ".join([reading] * count)
    return f"FLASER {count} {readings} {x + mount} 0 0 {x} 0 0 {stamp} host 0.1"


def test_carmen_log_keeps_its_stamps_as_written() -> None:
    log = parse_carmen(
        ["# comment", "PARAM robot_width 0.5 0 host 0", "ODOM 0 0 0 0 0 0 1 host 1", flaser(180, 0.0), flaser(180, 0.5)]
    )
    assert [scan.stamp for scan in log.scans] == ["976052857.337534"] * 2
    assert log.scans[1].odom == Pose2(0.5, 0.0, 0.0)
    assert log.scans[0].angle_min == pytest.approx(-math.pi / 2)
    assert log.scans[0].angle_step == pytest.approx(math.radians(1.0))
    assert log.problems == [] and log.mount == Pose2()


@pytest.mark.parametrize(("count", "step"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5), (401, 0.25), (91, 2.0)])
def test_angle_between_beams_follows_their_number(count: int, step: float) -> None:
    assert parse_carmen([flaser(count, 0.0)]).scans[0].angle_step == pytest.approx(math.radians(step))


def test_constant_offset_of_laser_to_robot_is_the_mount() -> None:
    log = parse_carmen([flaser(181, float(k), mount=0.35) for k in range(5)])
    assert log.mount.x == pytest.approx(0.35)


def test_drifting_offset_of_laser_to_robot_is_no_mount() -> None:
    lines = [f"FLASER 181 {'1.0 ' * 181}{k * 1.3} {k * 0.4} 0 {k} 0 0 {k}.0 host 0" for k in range(9)]
    log = parse_carmen(lines)
    assert log.mount == Pose2()
    assert "is not constant" in log.problems[0]
    assert parse_carmen(["PARAM robot_frontlaser_offset 0.3 0 h 0", *lines]).mount.x == pytest.approx(0.3)


def test_parameters_place_a_laser_sideways_and_turned() -> None:
    lines = [f"FLASER 181 {'1.0 ' * 181}{k * 1.3} {k * 0.4} 0 {k} 0 0 {k}.0 host 0" for k in range(9)]
    parameters = [
        "PARAM robot_frontlaser_side_offset -0.1 h 0",
        "PARAM robot_frontlaser_angular_offset 0.2 h 0",
        "PARAM robot_frontlaser_offset 0.3 h 0",
    ]
    assert parse_carmen([*parameters, *lines]).mount == Pose2(0.3, -0.1, 0.2)


def test_laser_pose_is_the_odometry_if_the_robot_pose_is_unset() -> None:
    log = parse_carmen([f"FLASER 180 {'1.0 ' * 180}{k} 0 0.1 0 0 0 {k}.0 host 0" for k in range(4)])
    assert [scan.odom.x for scan in log.scans] == [0.0, 1.0, 2.0, 3.0]
    assert (log.mount.x, log.mount.y, log.mount.yaw) == pytest.approx((0.0, 0.0, 0.0))
    assert "never changes" in log.problems[0]


def test_gzip_log_is_read_and_a_truncated_one_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.log.gz"
    whole = gzip.compress("\n".join(flaser(180, 0.1 * k, reading=f"{k}.25") for k in range(50)).encode())
    path.write_bytes(whole)
    assert len(read_carmen(path).scans) == 50
    for damaged in (whole[:-20], whole[:6], whole[:40] + b"\0" * 60 + whole[100:]):
        path.write_bytes(damaged)
        with pytest.raises(MalformedFile, match=r"x.log.gz: the compressed log is damaged"):
            read_carmen(path)


def test_robotlaser_lines_carry_their_own_field_of_view() -> None:
    head = "ROBOTLASER1 0 -1.0 2.0 0.5 80.0 0.1 0 5 1 2 3 4 5 0 "
    log = parse_carmen([head + "0.1 0 0 0 0 0 0 0 0 0 0 123.456789 host 1.5"])
    scan = log.scans[0]
    assert (scan.angle_min, scan.angle_step, scan.stamp) == (-1.0, 0.5, "123.456789")
    np.testing.assert_array_equal(scan.ranges, [1, 2, 3, 4, 5])


def test_broken_lines_are_reported_and_skipped() -> None:
    lines = [flaser(180, 0.1 * k) for k in range(30)]
    lines[4] = lines[4][:300]
    lines[9] = lines[9].replace("976052857.337534", "never")
    log = parse_carmen(lines)
    assert len(log.scans) == 28 and log.broken == 2
    assert "line 5" in log.problems[0] and "line 10" in log.problems[1]


@pytest.mark.parametrize(
    "bad",
    [
        "FLASER",
        "FLASER x",
        "FLASER -3",
        "FLASER 99999999 1",
        "FLASER 3 1 2 3 0 0 0 0 nan 0 1 h 1",
        "FLASER 3 1 2 3 0 0 0 0 0 0",
    ],
)
def test_file_of_broken_scans_is_refused_by_line(bad: str) -> None:
    with pytest.raises(MalformedFile, match=r"some.log:2: "):
        parse_carmen(["# log", bad, bad], "some.log")


def test_file_without_scans_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.log").write_bytes(bytes(range(256)) * 20)
    with pytest.raises(MalformedFile, match="no FLASER"):
        read_carmen(tmp_path / "x.log")


# -- trajectories --------------------------------------------------------------------------------------------------------


def test_trajectory_keeps_the_digits_of_its_stamps(tmp_path: Path) -> None:
    write_tum(tmp_path / "t.tum", ["976052857.337534", "5"], [Pose2(1.0, 2.0, math.pi / 2), Pose2()])
    first, second = (line.split() for line in (tmp_path / "t.tum").read_text().splitlines())
    assert first[0] == "976052857.337534" and second[0] == "5"
    assert [float(v) for v in first[1:4]] == [1.0, 2.0, 0.0]
    assert float(first[6]) == pytest.approx(math.sin(math.pi / 4)) and float(first[7]) == pytest.approx(math.cos(math.pi / 4))
    assert format_tum([], []) == ""
