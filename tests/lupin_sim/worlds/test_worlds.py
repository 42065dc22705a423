"""Every world is valid, repeatable and drivable; layout files become worlds."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from lupin_sim.reachability import FreeSpace, reachable_tags
from lupin_sim.world import SPECIES, Box, World
from lupin_sim.worlds import WorldError, load_world
from lupin_sim.worlds.layout import COURSE_STRETCH
from lupin_sim.worlds.random_world import KNOWN_IDS
from lupin_sim.worlds.walled import FENCED_TAG

RANDOM = [f"random:{seed}" for seed in range(1, 31)]
NAMED = ["demo", "course", "walled"]


def gap(one: Box, other: Box) -> float:
    return min(other.distance_to(*corner) for corner in one.corners())


def assert_valid(world: World) -> None:
    x0, y0, x1, y1 = world.bounds
    boxes = {box.name: box for box in world.boxes}
    assert len(boxes) == len(world.boxes)
    assert len({tag.id for tag in world.tags}) == len(world.tags)
    for box in world.boxes:
        assert all(x0 - 1e-6 <= x <= x1 + 1e-6 and y0 - 1e-6 <= y <= y1 + 1e-6 for x, y in box.corners())
        for other in world.boxes:
            assert other is box or gap(box, other) > 0.0
    assert world.clearance(world.start.x, world.start.y) >= 0.35
    for tag in world.tags:
        assert tag.id in KNOWN_IDS
        assert boxes[tag.box].distance_to(tag.x, tag.y) < 1e-6
        # 5 mm along the normal is outside the box, 5 mm against it is inside.
        assert boxes[tag.box].distance_to(*tag.pose.apply(0.005, 0.0)) == pytest.approx(0.005)
        assert boxes[tag.box].distance_to(*tag.pose.apply(-0.005, 0.0)) == 0.0
    for flower in world.flowers:
        tag = world.tag(flower.tag_id)
        assert boxes[tag.box].distance_to(flower.x, flower.y) == 0.0
        assert abs(tag.pose.inverse().apply(flower.x, flower.y)[1]) <= 0.35
        assert 0.42 <= flower.z <= 0.50
        assert flower.base_z == boxes[tag.box].height
    for tag in world.tags:
        assert sum(flower.tag_id == tag.id for flower in world.flowers) <= 3


@pytest.mark.parametrize("name", NAMED + RANDOM)
def test_world_is_valid(name: str) -> None:
    assert_valid(load_world(name))


@pytest.mark.parametrize("name", ["demo", "course", *RANDOM])
def test_all_tags_are_reachable(name: str) -> None:
    world = load_world(name)
    assert reachable_tags(world) == {tag.id for tag in world.tags}


@pytest.mark.parametrize("name", RANDOM)
def test_random_world_has_aisles_tags_and_flowers(name: str) -> None:
    world = load_world(name)
    assert 6 <= len(world.tags) <= 12
    assert {flower.species for flower in world.flowers} == set(SPECIES)
    assert any(flower.bug for flower in world.flowers)
    for box in world.boxes:
        for other in world.boxes:
            assert other is box or gap(box, other) >= 0.9


def test_seed_determines_the_random_world() -> None:
    assert load_world("random:7") == load_world("random:7") == load_world("random", seed=7)
    assert load_world("random:7") != load_world("random:8")


def test_demo_has_tags_flowers_bugs_and_loops() -> None:
    world = load_world("demo")
    assert len(world.tags) >= 10
    assert {flower.species for flower in world.flowers} == set(SPECIES)
    assert sum(flower.bug for flower in world.flowers) >= 2
    planters = [box for box in world.boxes if box.kind == "planter"]
    assert min(gap(a, b) for a in planters for b in planters if a is not b) >= 1.0
    # The robot can drive around the planters, which closes loops in its map.
    space = FreeSpace(world)
    assert all(space.reaches(x, y) for x, y in ((1.0, 0.9), (7.9, 1.0), (7.9, 6.0), (1.2, 6.2), (4.5, 2.8), (4.5, 4.4)))


def test_course_is_the_packaged_layout_stretched() -> None:
    world, tight = load_world("course"), load_world("course:1")
    assert len(world.tags) == len(tight.tags) == 29
    assert len(world.boxes) == 10
    assert {(round(b.width, 3), round(b.depth, 3)) for b in world.boxes} == {(1.1, 0.25), (0.25, 1.1)}
    assert len(reachable_tags(tight)) < 29
    spacings = world.boxes[1].y - world.boxes[2].y, tight.boxes[1].y - tight.boxes[2].y
    assert spacings[0] == pytest.approx(spacings[1] * COURSE_STRETCH)


def test_walled_has_one_unreachable_tag() -> None:
    world = load_world("walled")
    assert {tag.id for tag in world.tags} - reachable_tags(world) == {FENCED_TAG}
    # The posts stop the robot and not the view: there is no solid between the aisle and the tag.
    tag = world.tag(FENCED_TAG)
    assert world.clearance(*tag.pose.apply(1.4, 0.0)) > 0.25
    assert all(world.clearance(*tag.pose.apply(centimeters / 100, 0.0)) > 0.05 for centimeters in range(6, 140, 2))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("nowhere", "demo, course:STRETCH, random:SEED, walled"),
        ("random:seven", "whole number"),
        ("course:0.2", "1.0 to 5.0"),
        ("course:wide", "1.0 to 5.0"),
        ("demo:2", "takes no argument"),
        ("missing/layout.json", "cannot be read"),
    ],
)
def test_unknown_world_is_refused_with_the_known_ones(name: str, text: str) -> None:
    with pytest.raises(WorldError, match=text):
        load_world(name)


# -- layout files -----------------------------------------------------------------------------------------------------
GOOD = {
    "units": "m",
    "tables": {"BedA": {"x0": 0, "x1": 1.2, "y0": 0, "y1": 0.4}, "BedB": {"x0": 0, "x1": 1.2, "y0": 2.0, "y1": 2.4}},
    "tags": {"5": {"x": 0.2, "y": 0.5, "sensors": ["co2"]}, "12": {"x": 1.3, "y": 2.2, "sensors": []}},
}


def write(tmp_path: Path, document: dict[str, Any] | str) -> str:
    path = tmp_path / "layout.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document, indent=1))
    return str(path)


def test_layout_file_becomes_a_greenhouse(tmp_path: Path) -> None:
    world = load_world(write(tmp_path, GOOD))
    assert_valid(world)
    assert [tag.id for tag in world.tags] == [5, 12]
    north, east = world.tag(5), world.tag(12)
    assert (north.x, north.y, north.yaw) == pytest.approx((0.2, 0.4, math.pi / 2))
    assert (east.x, east.y, east.yaw) == pytest.approx((1.2, 2.2, 0.0))
    assert reachable_tags(world) == {5, 12}


def changed_layout(**changes: Any) -> dict[str, Any]:
    document = json.loads(json.dumps(GOOD))
    for path, value in changes.items():
        *parents, last = path.split("__")
        at = document
        for parent in parents:
            at = at[parent]
        at[last] = value
    result: dict[str, Any] = document
    return result


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ('{"units": "m",\n "tables": {\n', r"layout\.json:3: not JSON"),
        ("[1, 2]", "must be an object"),
        (changed_layout(units="ft"), r"layout\.json:2: units must be"),
        (changed_layout(tables={}), "at least one table"),
        (changed_layout(tables=None), "tables must be an object"),
        (changed_layout(tables__BedA__x1="wide"), r"layout\.json:4: tables\.BedA\.x1 must be a number"),
        (changed_layout(tables__BedA__x1=True), r"tables\.BedA\.x1 must be a number"),
        (changed_layout(tables__BedA__x1=-1), "must exceed|needs 0.125"),
        (changed_layout(tables__BedB=7), r"tables\.BedB must be an object"),
        (changed_layout(tags__5__y=None), r"tags\.5\.y must be a number"),
        (changed_layout(tags__one={"x": 0, "y": 0}), "'one' is not an id"),
        (changed_layout(tags__587={"x": 0, "y": 0}), "'587' is not an id"),
        (changed_layout(tags__5=[]), r"tags\.5 must be an object"),
    ],
)
def test_layout_error_names_file_and_problem(tmp_path: Path, document: dict[str, Any] | str, problem: str) -> None:
    path = write(tmp_path, document)
    with pytest.raises(WorldError, match=problem) as caught:
        load_world(path)
    assert str(caught.value).startswith(path)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity"])
def test_layout_number_that_is_not_finite_is_refused(tmp_path: Path, text: str) -> None:
    document = json.dumps(GOOD).replace('"x0": 0,', f'"x0": {text},', 1)
    with pytest.raises(WorldError, match="must be a number"):
        load_world(write(tmp_path, document))


def test_tags_at_one_place_are_placed_side_by_side(tmp_path: Path) -> None:
    document = changed_layout(tags={str(i): {"x": 0.6, "y": 0.5} for i in (1, 2, 3)})
    world = load_world(write(tmp_path, document))
    assert_valid(world)
    places = sorted(tag.x for tag in world.tags)
    assert all(b - a >= 0.125 for a, b in pairwise(places))


def test_too_many_tags_for_a_table_are_refused(tmp_path: Path) -> None:
    document = {
        "units": "m",
        "tables": {"Tiny": {"x0": 0, "x1": 0.2, "y0": 0, "y1": 0.2}},
        "tags": {str(i): {"x": 0.1, "y": 0.3} for i in range(1, 7)},
    }
    with pytest.raises(WorldError, match="has room"):
        load_world(write(tmp_path, document))


# -- reachability ------------------------------------------------------------------------------------------------------------
def test_gap_narrower_than_the_robot_is_not_passed() -> None:
    for width, expected in ((0.62, True), (0.42, False)):
        wall = (
            Box("left", 2.0, 1.0 - width / 4, 0.0, 2.0 - width / 2, 0.2),
            Box("right", 2.0, 3.0 + width / 4, 0.0, 2.0 - width / 2, 0.2),
        )
        world = World("two", (0.0, 0.0, 4.0, 4.0), wall, (), replace(load_world("demo").start, x=0.8, y=2.0))
        assert FreeSpace(world).reaches(3.2, 2.0) is expected


def test_point_outside_the_world_is_not_reachable() -> None:
    space = FreeSpace(load_world("demo"))
    assert not space.reaches(-1.0, 0.5)
    assert not space.reaches(1.0, 99.0)
