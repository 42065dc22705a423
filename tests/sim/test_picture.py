from itertools import pairwise

import cv2
import numpy as np
import pytest

from lupin_sim.picture import CAMERAS, Studio, film, picture
from lupin_sim.scene import Look
from lupin_sim.scoring import read_tum
from lupin_sim.tour import INSPECT, Frame, from_trajectory, tour
from lupin_sim.worlds import load_world

SMALL = Look(width=320, height=240)


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_camera_makes_a_picture_with_something_in_it(graphics, camera):
    with Studio(load_world("demo"), SMALL) as studio:
        studio.place(load_world("demo").start)
        image = studio.shoot(camera)
    assert image.shape == (240, 320, 3)
    assert image.std() > 10


def test_the_strips_colour_shows_in_the_picture(graphics):
    """The same view with red, green, blue and dark LEDs: the pixels that change take the colour."""
    world = load_world("demo")
    with Studio(world, SMALL) as studio:

        def shot(colour):
            studio.place(world.start, leds=colour)
            return studio.shoot("follow").astype(int)

        dark = shot((0, 0, 0))
        for channel, colour in enumerate(((255, 0, 0), (0, 255, 0), (0, 0, 255))):
            change = shot(colour) - dark
            lit = change[..., channel] > 80
            assert lit.sum() > 30
            others = [c for c in range(3) if c != channel]
            assert np.abs(change[lit][:, others]).mean() < 30


def test_a_picture_is_written(graphics, tmp_path):
    out = tmp_path / "walled.png"
    picture(load_world("walled"), out, "overview")
    assert cv2.imread(str(out)).shape == (960, 1280, 3)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_is_written(graphics, tmp_path, suffix):
    world = load_world("walled")
    frames = tour(world, 5.0)[:3]
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
def test_a_camera_or_file_type_that_does_not_exist_is_refused(tmp_path, camera, name, text):
    with pytest.raises(ValueError, match=text):
        picture(load_world("demo"), tmp_path / name, camera)
    assert not list(tmp_path.iterdir())


def test_a_tour_passes_every_tag_without_touching_anything():
    world = load_world("demo")
    frames = tour(world, 10.0)
    assert all(world.clearance(frame.pose.x, frame.pose.y) > 0.2 for frame in frames)
    assert all(b.time_s > a.time_s for a, b in pairwise(frames))
    looked_at = {
        min(world.tags, key=lambda tag: tag.pose.distance_to(frame.pose)).id
        for frame in frames
        if frame.arm == pytest.approx(INSPECT, abs=0.05)
    }
    assert looked_at == {tag.id for tag in world.tags}
    assert frames[-1].pose.distance_to(world.start) < 0.1


def test_a_tour_leaves_out_what_cannot_be_reached():
    world = load_world("walled")
    nearest = min(tour(world, 5.0), key=lambda frame: frame.pose.distance_to(world.tag(5).pose))
    assert nearest.pose.distance_to(world.tag(5).pose) > 0.9


def test_a_recorded_trajectory_becomes_frames(tmp_path):
    path = tmp_path / "t.tum"
    path.write_text("1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0.7071068 0.7071068\n")
    frames = from_trajectory(read_tum(path), 4.0)
    assert len(frames) == 5
    assert isinstance(frames[2], Frame)
    assert (frames[2].time_s, frames[2].pose.x) == pytest.approx((0.5, 0.5))
    assert frames[2].pose.yaw == pytest.approx(np.pi / 4)
