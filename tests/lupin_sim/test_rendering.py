"""Images, films and fly-throughs of a world."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from lupin_sim.flythrough import INSPECT, FilmFrame, flythrough, from_trajectory
from lupin_sim.rendering import CAMERAS, Renderer, film, picture
from lupin_sim.scene import Look
from lupin_sim.scoring import read_tum
from lupin_sim.worlds import load_world
from tests.support.optional import present

SMALL = Look(width=320, height=240)


@pytest.mark.usefixtures("graphics")
@pytest.mark.parametrize("camera", CAMERAS)
def test_every_camera_renders_a_varied_image(camera: str) -> None:
    with Renderer(load_world("demo"), SMALL) as renderer:
        renderer.place(load_world("demo").start)
        image = renderer.render(camera)
    assert image.shape == (240, 320, 3)
    assert image.std() > 10


@pytest.mark.usefixtures("graphics")
def test_led_color_is_visible_in_the_image() -> None:
    """In equal views with red, green, blue and dark LEDs, the pixels that differ have the LED's color."""
    world = load_world("demo")
    with Renderer(world, SMALL) as renderer:

        def view(color: tuple[int, int, int]) -> np.ndarray:
            renderer.place(world.start, leds=color)
            return renderer.render("follow").astype(int)

        dark = view((0, 0, 0))
        for channel, color in enumerate(((255, 0, 0), (0, 255, 0), (0, 0, 255))):
            change = view(color) - dark
            lit = change[..., channel] > 80
            assert lit.sum() > 30
            others = [c for c in range(3) if c != channel]
            assert np.abs(change[lit][:, others]).mean() < 30


@pytest.mark.usefixtures("graphics")
def test_picture_is_written(tmp_path: Path) -> None:
    out = tmp_path / "walled.png"
    picture(load_world("walled"), out, "overview")
    assert present(cv2.imread(str(out))).shape == (960, 1280, 3)


@pytest.mark.usefixtures("graphics")
@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_film_is_written(tmp_path: Path, suffix: str) -> None:
    world = load_world("walled")
    frames = flythrough(world, 5.0)[:3]
    out = tmp_path / f"drive{suffix}"
    film(world, out, frames, 5.0)
    film_reader = cv2.VideoCapture(str(out)) if suffix == ".mp4" else None
    if film_reader is not None:
        assert film_reader.get(cv2.CAP_PROP_FRAME_COUNT) == 3
        film_reader.release()
    else:
        assert out.read_bytes()[:6] == b"GIF89a"


@pytest.mark.parametrize(
    ("camera", "name", "text"),
    [("side", "a.png", "overview"), ("top", "a.bmp", r"\.png or \.jpg"), ("top", "a.mp4", r"\.png or \.jpg")],
)
def test_unknown_camera_or_file_type_is_refused(tmp_path: Path, camera: str, name: str, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        picture(load_world("demo"), tmp_path / name, camera)
    assert not list(tmp_path.iterdir())


def test_flythrough_inspects_every_tag_without_a_collision() -> None:
    world = load_world("demo")
    frames = flythrough(world, 10.0)
    assert all(world.clearance(frame.pose.x, frame.pose.y) > 0.2 for frame in frames)
    assert all(b.time_s > a.time_s for a, b in pairwise(frames))
    inspected = {
        min(world.tags, key=lambda tag: tag.pose.distance_to(frame.pose)).id
        for frame in frames
        if frame.arm == pytest.approx(INSPECT, abs=0.05)
    }
    assert inspected == {tag.id for tag in world.tags}
    assert frames[-1].pose.distance_to(world.start) < 0.1


def test_flythrough_skips_unreachable_tags() -> None:
    world = load_world("walled")
    nearest = min(flythrough(world, 5.0), key=lambda frame: frame.pose.distance_to(world.tag(5).pose))
    assert nearest.pose.distance_to(world.tag(5).pose) > 0.9


def test_trajectory_is_converted_to_frames(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text("1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0.7071068 0.7071068\n")
    frames = from_trajectory(read_tum(path), 4.0)
    assert len(frames) == 5
    assert isinstance(frames[2], FilmFrame)
    assert (frames[2].time_s, frames[2].pose.x) == pytest.approx((0.5, 0.5))
    assert frames[2].pose.yaw == pytest.approx(np.pi / 4)
