"""Surfaces, their coverage by the camera, viewpoints, and the explorer's choices."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission import coverage as coverage_module
from lupin_runtime.mission.clearance import ClearanceMap
from lupin_runtime.mission.coverage import Coverage
from lupin_runtime.mission.explorer import MAX_FAILURES, ExplorationGoal, Explorer
from lupin_runtime.mission.kernels import CameraModel, travel_distances
from lupin_runtime.mission.surfaces import find_surfaces
from lupin_runtime.mission.viewpoints import Viewpoint, ViewpointPlanner, is_worthwhile

RES = 0.05


def _room(
    boxes: Sequence[tuple[float, float, float, float]] = ((3.0, 2.0, 0.8, 0.4),), size: tuple[float, float] = (6.0, 5.0)
) -> GridMap:
    """Return a room of size (x, y) meters with 0.1 m walls and boxes (center x, y, width, depth); the origin is its corner."""
    cells = np.zeros((round(size[1] / RES), round(size[0] / RES)), np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    for x, y, width, depth in boxes:
        rows = slice(round((y - depth / 2) / RES), round((y + depth / 2) / RES))
        columns = slice(round((x - width / 2) / RES), round((x + width / 2) / RES))
        cells[rows, columns] = 100
        cells[rows.start + 2 : rows.stop - 2, columns.start + 2 : columns.stop - 2] = -1  # lidar cannot see the inside
    return GridMap(cells, RES, 0.0, 0.0)


def _unseen(coverage: Coverage, grid: GridMap) -> np.ndarray[Any, Any]:
    coverage.update(grid)
    return coverage.unseen()[0]


# -- surfaces ----------------------------------------------------------------------------------------------------------


def test_box_sides_have_outward_normals_and_walls_are_marked() -> None:
    surfaces = find_surfaces(_room())
    box = surfaces.rows[~surfaces.wall]
    assert len(box) == 2 * (16 + 8)
    for beyond, normal, count in (
        (box[:, 0] > 3.4, (1.0, 0.0), 8),
        (box[:, 0] < 2.6, (-1.0, 0.0), 8),
        (box[:, 1] > 2.2, (0.0, 1.0), 16),
        (box[:, 1] < 1.8, (0.0, -1.0), 16),
    ):
        assert beyond.sum() == count
        np.testing.assert_allclose(box[beyond][:, 2:], [normal] * count, atol=1e-9)
    assert surfaces.wall.sum() > 300


def test_both_sides_of_thin_wall_face_outwards() -> None:
    cells = np.zeros((60, 60), np.int8)
    cells[20:40, 30] = 100
    rows = find_surfaces(GridMap(cells, RES, 0.0, 0.0)).rows
    inner = rows[(rows[:, 1] > 1.2) & (rows[:, 1] < 1.8)]
    assert set(np.sign(inner[:, 2])) == {-1.0, 1.0}
    assert np.all(np.abs(inner[:, 2]) > 0.99)
    assert np.all(np.sign(inner[:, 0] - 1.525) == np.sign(inner[:, 2]))


def test_slanted_side_has_slanted_normal() -> None:
    r, c = np.mgrid[0:80, 0:80]
    cells = np.where(np.abs(r - c) < 6, 100, 0).astype(np.int8)
    rows = find_surfaces(GridMap(cells, RES, 0.0, 0.0)).rows
    inner = rows[(rows[:, 0] > 1.0) & (rows[:, 0] < 3.0)]
    np.testing.assert_allclose(np.abs(inner[:, 2:]), math.sqrt(0.5), atol=0.01)
    assert np.all(np.sign(inner[:, 0] - inner[:, 1]) == np.sign(inner[:, 2]))


@pytest.mark.parametrize("degrees", [3.0, 10.0, 25.0, 45.0, 70.0])
def test_rotated_box_has_rotated_normals(degrees: float) -> None:
    turn = math.radians(degrees)
    r, c = np.mgrid[0:100, 0:100]
    x, y = (c + 0.5) * RES - 2.5, (r + 0.5) * RES - 2.5
    u, v = math.cos(turn) * x + math.sin(turn) * y, -math.sin(turn) * x + math.cos(turn) * y
    cells = np.where((np.abs(u) < 0.8) & (np.abs(v) < 0.5), 100, 0).astype(np.int8)
    rows = find_surfaces(GridMap(cells, RES, -2.5, -2.5)).rows
    u = math.cos(turn) * rows[:, 0] + math.sin(turn) * rows[:, 1]
    v = -math.sin(turn) * rows[:, 0] + math.cos(turn) * rows[:, 1]
    front = (u > 0.75) & (np.abs(v) < 0.35)
    off = np.arccos(np.clip(rows[front, 2] * math.cos(turn) + rows[front, 3] * math.sin(turn), -1.0, 1.0))
    assert front.sum() >= 12
    assert np.median(off) < math.radians(12.0)
    assert np.mean(off < math.radians(30.0)) > 0.9


def test_specks_have_no_surface() -> None:
    cells = np.zeros((40, 40), np.int8)
    cells[10, 10] = cells[20, 20] = cells[20, 21] = 100
    assert len(find_surfaces(GridMap(cells, RES, 0.0, 0.0)).rows) == 0


def test_boxes_without_outer_walls_are_not_walls() -> None:
    grid = _room(boxes=((2.0, 2.0, 1.1, 0.25), (2.0, 3.5, 1.1, 0.25), (4.5, 2.0, 1.1, 0.25)))
    cells = grid.cells.copy()
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 0, 0, 0, 0
    assert not find_surfaces(GridMap(cells, RES, 0.0, 0.0)).wall.any()


# -- coverage ----------------------------------------------------------------------------------------------------------


def test_one_view_shows_the_facing_side_only() -> None:
    grid = _room()
    coverage = Coverage()
    coverage.note_pose(Pose2(3.0, 0.8, math.pi / 2), 1.0)
    unseen = _unseen(coverage, grid)
    south = unseen[(unseen[:, 3] < -0.9) & (np.abs(unseen[:, 0] - 3.0) < 0.3)]
    north = unseen[unseen[:, 3] > 0.9]
    assert len(south) == 0
    assert len(north) == 16


@pytest.mark.parametrize(
    ("pose", "why"),
    [
        (Pose2(3.0, 0.8, -math.pi / 2), "it looks away"),
        (Pose2(3.0, 0.2, 0.3), "it is out of the field of view"),
        (Pose2(0.6, 1.6, 0.0), "the angle is too flat"),
    ],
)
def test_surface_outside_camera_model_stays_unseen(pose: Pose2, why: str) -> None:
    grid = _room()
    coverage = Coverage()
    coverage.note_pose(pose, 1.0)
    assert len(_unseen(coverage, grid)) == 48, why


def test_surface_beyond_range_stays_unseen() -> None:
    grid = _room(size=(6.0, 9.0), boxes=((3.0, 6.0, 0.8, 0.4),))
    coverage = Coverage()
    coverage.note_pose(Pose2(3.0, 3.6, math.pi / 2), 1.0)
    assert len(_unseen(coverage, grid)) == 48


def test_surface_needs_min_view_time() -> None:
    grid = _room()
    coverage = Coverage(min_view_s=0.5)
    coverage.note_pose(Pose2(3.0, 0.8, math.pi / 2), 0.2)
    assert len(_unseen(coverage, grid)) == 48
    coverage.note_pose(Pose2(3.0, 0.8, math.pi / 2), 0.4)
    assert len(_unseen(coverage, grid)) < 40


def test_box_in_front_hides_a_side() -> None:
    hidden = _room(boxes=((3.0, 2.6, 0.8, 0.4), (3.0, 1.6, 1.6, 0.2)))
    coverage = Coverage()
    coverage.note_pose(Pose2(3.0, 0.8, math.pi / 2), 1.0)
    unseen = _unseen(coverage, hidden)
    assert len(unseen[(unseen[:, 3] < -0.9) & (unseen[:, 1] > 2.0)]) == 16


def test_seen_surfaces_survive_growing_map() -> None:
    grid = _room()
    coverage = Coverage()
    coverage.note_pose(Pose2(3.0, 0.8, math.pi / 2), 1.0)
    before = _unseen(coverage, grid)
    grown = np.full((grid.height + 40, grid.width + 60), -1, np.int8)
    grown[30 : 30 + grid.height, 20 : 20 + grid.width] = grid.cells
    after = _unseen(coverage, GridMap(grown, RES, -20 * RES, -30 * RES))
    assert sorted(map(tuple, np.round(before, 6))) == sorted(map(tuple, np.round(after, 6)))


def test_pose_history_is_bounded_without_losing_coverage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coverage_module, "MAX_SAMPLES", 100)
    grid = _room()
    coverage = Coverage()
    coverage.note_pose(Pose2(3.0, 0.8, math.pi / 2), 1.0)
    seen = len(_unseen(coverage, grid))
    for i in range(1000):
        coverage.note_pose(Pose2(0.5 + 0.04 * (i % 50), 4.5, math.pi / 2), 0.2)
        if i % 97 == 0:
            coverage.update(grid)
    assert len(coverage._samples) <= 100
    assert len(_unseen(coverage, grid)) == seen
    assert len(_unseen(coverage, _room())) <= seen + 4  # on a new map the thinned history gives nearly the same result


def test_invalid_poses_are_ignored() -> None:
    coverage = Coverage()
    coverage.note_pose(Pose2(math.nan, 0.0, 0.0), 1.0)
    coverage.note_pose(Pose2(0.0, 0.0, 0.0), 0.0)
    assert coverage._samples == []


def test_outer_walls_count_only_with_a_weight() -> None:
    grid = _room(boxes=())
    assert len(_unseen(Coverage(), grid)) == 0
    assert len(_unseen(Coverage(wall_weight=0.3), grid)) > 300


# -- viewpoints --------------------------------------------------------------------------------------------------------


def _viewpoints(coverage: Coverage, grid: GridMap, robot: Pose2) -> tuple[ClearanceMap, list[Viewpoint]]:
    coverage.update(grid)
    clearance = ClearanceMap.from_grid(grid)
    travel = travel_distances(clearance, robot, 0.24)
    assert travel is not None
    return clearance, ViewpointPlanner(coverage, clearance, travel, 0.32, 0.24).rank(robot)


def test_viewpoints_are_reachable_and_show_their_gain() -> None:
    grid = _room()
    coverage = Coverage()
    robot = Pose2(0.6, 0.6, 0.0)
    clearance, found = _viewpoints(coverage, grid, robot)
    assert found
    for viewpoint in found:
        assert clearance.distance_at(viewpoint.pose.x, viewpoint.pose.y) >= 0.32
        assert viewpoint.travel_m >= 0.9 * math.hypot(viewpoint.pose.x - robot.x, viewpoint.pose.y - robot.y) - 0.1
        assert is_worthwhile(coverage, viewpoint.pose)
    before = len(_unseen(coverage, grid))
    coverage.note_pose(found[0].pose, 1.0)
    assert before - len(_unseen(coverage, grid)) == pytest.approx(found[0].gain_m / RES)


def test_narrow_aisle_has_no_viewpoint() -> None:
    grid = _room(boxes=((3.0, 2.0, 2.4, 0.4), (3.0, 2.6, 2.4, 0.4)))  # 0.2 m between them
    _, found = _viewpoints(Coverage(), grid, Pose2(0.6, 0.6, 0.0))
    for viewpoint in found:
        assert not 1.9 < viewpoint.pose.y < 2.7 or not 1.8 < viewpoint.pose.x < 4.2


def test_room_behind_wall_has_no_viewpoint() -> None:
    cells = _room(boxes=((4.5, 2.5, 0.8, 0.4),)).cells.copy()
    cells[:, 56:58] = 100  # a wall at x = 2.8
    _, found = _viewpoints(Coverage(), GridMap(cells, RES, 0.0, 0.0), Pose2(1.0, 1.0, 0.0))
    assert all(viewpoint.pose.x < 2.8 for viewpoint in found)


def test_unseen_surfaces_are_given_up_after_tries() -> None:
    grid = _room()
    coverage = Coverage(max_tries=2)
    for _ in range(200):
        _, found = _viewpoints(coverage, grid, Pose2(0.6, 0.6, 0.0))
        if not found:
            break
        coverage.count_try(found[0].pose)
    assert found == []


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_travel_distances_match_dijkstra(seed: int) -> None:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    rng = np.random.default_rng(seed)
    free = rng.random((24, 31)) > 0.3
    free[12, 15] = True
    grid = GridMap(np.where(free, 0, 100).astype(np.int8), 1.0, 0.0, 0.0)
    clearance = ClearanceMap(grid, free.astype(np.float32), free)
    found = travel_distances(clearance, Pose2(15.5, 12.5, 0.0), 0.5)
    rows, columns, lengths = [], [], []
    for r, c in zip(*np.nonzero(free)):
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1)):
            a, b = r + dr, c + dc
            if 0 <= a < 24 and 0 <= b < 31 and free[a, b] and free[r, b] and free[a, c]:
                rows.append(r * 31 + c)
                columns.append(a * 31 + b)
                lengths.append(1.4 if dr and dc else 1.0)
    expected = dijkstra(coo_matrix((lengths, (rows, columns)), shape=(24 * 31, 24 * 31)).tocsr(), indices=12 * 31 + 15)
    assert found is not None
    np.testing.assert_allclose(found.ravel(), expected, rtol=1e-5)


def test_travel_distances_are_none_outside_free_space() -> None:
    grid = _room()
    assert travel_distances(ClearanceMap.from_grid(grid), Pose2(3.0, 2.0, 0.0), 5.0) is None
    assert travel_distances(ClearanceMap.from_grid(grid), Pose2(90.0, -40.0, 0.0), 0.24) is None


# -- the explorer ------------------------------------------------------------------------------------------------------


class _Drive:
    """Drives a robot to the explorer's goals, with its camera looking ahead."""

    def __init__(self, explorer: Explorer, pose: Pose2) -> None:
        self.explorer, self.pose, self.map_number, self.now_s, self.length_m = explorer, pose, 0, 0.0, 0.0
        self.goals: list[ExplorationGoal] = []

    def run(self, grid: GridMap, reach: Callable[[ExplorationGoal], bool] = lambda _goal: True, limit: int = 400) -> None:
        for _ in range(limit):
            self.map_number += 1
            self.now_s += 5.0
            goal = self.explorer.choose(grid, self.map_number, self.pose, self.now_s)
            if goal is None:
                return
            self.goals.append(goal)
            if not reach(goal):
                self.explorer.record_failure(goal, self.map_number, self.now_s)
                continue
            heading = math.atan2(goal.pose.y - self.pose.y, goal.pose.x - self.pose.x)
            length = self.pose.distance_to(goal.pose)
            for f in np.arange(0.0, 1.0, 0.08 / max(length, 0.08)):
                x, y = self.pose.x + f * (goal.pose.x - self.pose.x), self.pose.y + f * (goal.pose.y - self.pose.y)
                self.explorer.note_pose(Pose2(x, y, heading), 0.2)
            self.length_m += length
            self.pose = goal.pose
            for _ in range(5):
                self.explorer.note_pose(self.pose, 0.2)
            self.explorer.record_arrival(goal, self.map_number)
        pytest.fail("the exploration does not end")


BOXES = tuple((1.6 + 2.0 * i, 1.5 + 1.8 * j, 0.8, 0.4) for i in range(3) for j in range(3))


def test_exploration_sees_all_sides_on_a_short_path() -> None:
    grid = _room(BOXES, size=(7.0, 7.0))
    coverage = Coverage()
    drive = _Drive(Explorer(coverage=coverage), Pose2(0.5, 0.5, 0.0))
    drive.run(grid)
    assert coverage.seen_fraction() > 0.97
    assert len(drive.goals) <= 4 * len(BOXES)
    assert drive.length_m < 60.0


def test_unreachable_viewpoints_end_the_search() -> None:
    grid = _room(BOXES, size=(7.0, 7.0))
    drive = _Drive(Explorer(coverage=Coverage()), Pose2(0.5, 0.5, 0.0))
    drive.run(grid, reach=lambda goal: goal.pose.x < 3.0)
    assert 0 < len(drive.goals) < 200


def _corridor() -> GridMap:
    """Return a map that is free for 3 m and unknown beyond."""
    cells = np.full((40, 120), -1, np.int8)
    cells[2:-2, :60] = 0
    cells[:2], cells[-2:] = 100, 100
    return GridMap(cells, RES, 0.0, 0.0)


def test_unreachable_frontier_is_given_up() -> None:
    drive = _Drive(Explorer(), Pose2(0.5, 1.0, 0.0))
    drive.run(_corridor(), reach=lambda _goal: False)
    assert len(drive.goals) == MAX_FAILURES


def test_frontier_unchanged_by_visits_is_given_up() -> None:
    drive = _Drive(Explorer(), Pose2(0.5, 1.0, 0.0))
    drive.run(_corridor())
    assert len(drive.goals) == 2


def test_visited_frontier_is_judged_on_a_newer_map() -> None:
    explorer, grid, robot = Explorer(), _corridor(), Pose2(0.5, 1.0, 0.0)
    goal = explorer.choose(grid, 3, robot, 0.0)
    assert goal is not None
    explorer.record_arrival(goal, 3)
    assert explorer.choose(grid, 3, robot, 1.0) is None
    assert explorer.choose(grid, 4, robot, 2.0) is not None


def test_frontier_has_priority_over_distant_viewpoint() -> None:
    cells = _room(((1.6, 1.2, 0.8, 0.4),), size=(8.0, 5.0)).cells.copy()
    cells[:, 120:] = -1
    grid = GridMap(cells, RES, 0.0, 0.0)
    far = Explorer(coverage=Coverage()).choose(grid, 1, Pose2(5.5, 4.0, 0.0), 0.0)
    near = Explorer(coverage=Coverage()).choose(grid, 1, Pose2(1.0, 0.5, 0.0), 0.0)
    assert far is not None and far.kind == "frontier"
    assert near is not None and near.kind == "viewpoint"


def test_goal_is_useful_while_it_shows_something_new() -> None:
    explorer, robot = Explorer(coverage=Coverage()), Pose2(0.6, 0.6, 0.0)
    grid = _room()
    goal = explorer.choose(grid, 1, robot, 0.0)
    assert goal is not None and goal.kind == "viewpoint"
    assert explorer.is_useful(goal, grid)
    explorer.note_pose(goal.pose, 1.0)
    assert not explorer.is_useful(goal, grid)
    frontier = ExplorationGoal("frontier", Pose2(2.9, 1.0, 0.0))
    assert Explorer().is_useful(frontier, _corridor())
    assert not Explorer().is_useful(frontier, _room())


def test_frontier_is_chosen_without_robot_pose() -> None:
    goal = Explorer(coverage=Coverage()).choose(_corridor(), 1, None, 0.0)
    assert goal is not None
    assert goal.pose.yaw == 0.0


def test_camera_model_range_is_within_detector_range() -> None:
    camera = CameraModel()
    head_on_m = camera.focal_px * camera.tag_edge_m / camera.min_tag_px
    assert head_on_m > camera.max_range_m
