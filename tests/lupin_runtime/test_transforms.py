"""The transform tree: composition, interpolation, and errors."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.transforms import Transform, TransformTree, TransformUnavailable

finite = st.floats(-10.0, 10.0)
angles = st.floats(-math.pi, math.pi)


@st.composite
def transforms(draw: st.DrawFn) -> Transform:
    x, y, z, angle = draw(finite), draw(finite), draw(finite), draw(angles)
    axis = draw(st.sampled_from([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.8)]))
    s = math.sin(angle / 2.0)
    return Transform((x, y, z), (axis[0] * s, axis[1] * s, axis[2] * s, math.cos(angle / 2.0)))


def close(a: Transform, b: Transform) -> bool:
    # q and -q are the same rotation
    same = min(math.dist(a.rotation, b.rotation), math.dist(a.rotation, tuple(-v for v in b.rotation)))
    return math.dist(a.translation, b.translation) < 1e-6 and same < 1e-6


@given(transforms(), transforms(), transforms())
def test_composition_is_associative_and_inverse_undoes(a: Transform, b: Transform, c: Transform) -> None:
    assert close((a @ b) @ c, a @ (b @ c))
    assert close(a @ a.inverse(), Transform())


@given(transforms(), transforms(), transforms())
def test_lookup_across_a_fork_equals_the_product_of_its_edges(a: Transform, b: Transform, c: Transform) -> None:
    tree = TransformTree()
    tree.insert("map", "odom", 1, a)
    tree.insert("odom", "base_link", 1, b)
    tree.insert("base_link", "laser", 0, c, static=True)
    assert close(tree.lookup("map", "laser"), a @ b @ c)
    assert close(tree.lookup("laser", "map"), (a @ b @ c).inverse())


def test_lookup_interpolates_but_never_extrapolates() -> None:
    tree = TransformTree()
    half_turn = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))
    tree.insert("odom", "base_link", 1_000, Transform((0.0, 0.0, 0.0)))
    tree.insert("odom", "base_link", 2_000, Transform((2.0, 0.0, 0.0), half_turn))
    middle = tree.lookup("odom", "base_link", 1_500)
    assert middle.translation == pytest.approx((1.0, 0.0, 0.0))
    assert middle.rotation == pytest.approx((0.0, 0.0, math.sin(math.pi / 8), math.cos(math.pi / 8)))
    for outside in (999, 2_001):
        with pytest.raises(TransformUnavailable, match="base_link"):
            tree.lookup("odom", "base_link", outside)


def test_newest_common_time_is_that_of_the_slowest_edge() -> None:
    tree = TransformTree()
    tree.insert("map", "odom", 100, Transform())
    tree.insert("odom", "base_link", 100, Transform((1.0, 0.0, 0.0)))
    tree.insert("odom", "base_link", 200, Transform((2.0, 0.0, 0.0)))
    assert tree.newest_ns("map", "base_link") == 100
    assert tree.lookup("map", "base_link").translation[0] == pytest.approx(1.0)


def test_unconnected_frames_are_named() -> None:
    tree = TransformTree()
    tree.insert("map", "odom", 1, Transform())
    with pytest.raises(TransformUnavailable, match="'tag_7'"):
        tree.lookup("map", "tag_7")


def test_non_finite_sample_is_refused() -> None:
    tree = TransformTree()
    tree.insert("map", "odom", 1, Transform((1.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match="not finite"):
        tree.insert("map", "odom", 2, Transform((math.nan, 0.0, 0.0)))
    assert tree.lookup("map", "odom").translation[0] == 1.0


def test_loop_of_frames_is_refused() -> None:
    tree = TransformTree()
    tree.insert("a", "b", 1, Transform())
    tree.insert("b", "a", 1, Transform())
    with pytest.raises(TransformUnavailable, match="loop"):
        tree.lookup("a", "c")


def test_history_is_bounded_in_time() -> None:
    tree = TransformTree(keep_s=1.0)
    for i in range(100):
        tree.insert("odom", "base_link", i * 100_000_000, Transform((float(i), 0.0, 0.0)))
    with pytest.raises(TransformUnavailable):
        tree.lookup("odom", "base_link", 8_000_000_000)
    assert tree.lookup("odom", "base_link", 9_000_000_000).translation[0] == pytest.approx(90.0)


def test_clock_jump_back_restarts_history_a_late_sample_does_not() -> None:
    tree = TransformTree(keep_s=1.0)
    second = 1_000_000_000
    tree.insert("odom", "base_link", 500 * second, Transform((1.0, 0.0, 0.0)))
    tree.insert("odom", "base_link", 10 * second, Transform((2.0, 0.0, 0.0)))
    tree.insert("odom", "base_link", 501 * second, Transform((3.0, 0.0, 0.0)))
    assert tree.lookup("odom", "base_link").translation[0] == 3.0
    for i in range(5):
        tree.insert("odom", "base_link", (20 + i) * second // 2, Transform((10.0 + i, 0.0, 0.0)))
    assert tree.newest_ns("odom", "base_link") == 12 * second
    assert tree.lookup("odom", "base_link", 12 * second).translation[0] == 14.0
