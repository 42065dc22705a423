"""After the release of the e-stop nothing moves without a newer command: every source of motion, on a simulated run."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.release_cases import CASES, Case
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


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in CASES])
def test_release_moves_nothing_and_a_newer_command_does(rig: ReleaseRig, case: Case) -> None:
    measured = rig.measure(case, PRESS_S, WATCH_S)
    assert measured.base_m <= LIMIT_M
    assert measured.joints_rad <= LIMIT_RAD
    assert measured.newer_command_moves


MISSED_PRESS_CASES = ("NavigateToPose of another client", "mission")


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in CASES if case.name in MISSED_PRESS_CASES])
def test_press_that_the_estop_missed_stops_like_any_other(rig: ReleaseRig, case: Case) -> None:
    measured = rig.measure(case, PRESS_S, WATCH_S, estop_hangs=True)
    assert measured.base_m <= LIMIT_M
    assert measured.newer_command_moves
