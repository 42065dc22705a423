"""After the release of the e-stop nothing moves without a newer command: every source of motion, on a simulated run."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.hang import Hang
from tests.support.motion_sources import ALL_AT_ONCE, SOURCES, MotionSource, find_source
from tests.support.release_rig import ReleaseRig

pytestmark = [pytest.mark.mission, pytest.mark.sim, pytest.mark.graph]

PRESS_S, WATCH_S = 1.0, 3.0
LIMIT_M, LIMIT_RAD = 0.001, 0.02


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, make_up: Callable[..., Any]) -> Iterator[ReleaseRig]:
    folder: Path = tmp_path_factory.mktemp("release")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder / "config"))  # the arm library
        run = make_up(folder, "--headless", "--json", "--world", "walled", "--no-record", "--no-cameras")
        try:
            run.wait_up()
            rig = ReleaseRig(run.folder())
            yield rig
            rig.close()
            run.process.send_signal(signal.SIGINT)
            assert run.result()[0] == 130
        finally:
            run.end()


@pytest.mark.parametrize("source", [pytest.param(source, id=source.name) for source in (*SOURCES, ALL_AT_ONCE)])
def test_release_moves_nothing_and_a_newer_command_does(rig: ReleaseRig, source: MotionSource) -> None:
    measured = rig.measure(source, PRESS_S, WATCH_S)
    assert measured.base_m <= LIMIT_M
    assert measured.joints_rad <= LIMIT_RAD
    assert measured.newer_command_moves


MISSED_PRESS_SOURCES = ("NavigateToPose of another client", "mission")


@pytest.mark.parametrize(
    "source", [pytest.param(source, id=source.name) for source in SOURCES if source.name in MISSED_PRESS_SOURCES]
)
def test_press_that_the_estop_missed_stops_like_any_other(rig: ReleaseRig, source: MotionSource) -> None:
    measured = rig.measure(source, PRESS_S, WATCH_S, Hang("estop"))
    assert measured.base_m <= LIMIT_M
    assert measured.newer_command_moves


# A hang is noticed after 0.5 s, an exit at once. Only after 2 s is a hung process replaced, which could also hold the arm.
ARM_REST_S = 2.0


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_estop_stops_a_replay_without_its_process(rig: ReleaseRig, number: signal.Signals) -> None:
    guard = rig.log("drive").count("holding the arm")
    measured = rig.measure(find_source("arm replay"), PRESS_S, WATCH_S, Hang("body", number))
    assert measured.joints_rest_s <= ARM_REST_S
    assert measured.joints_rad <= LIMIT_RAD
    assert measured.newer_command_moves
    assert rig.log("drive").count("holding the arm") > guard
