"""A sample of the generated faults on a booted robot: the doctor is right about each."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bench.bench_generated import Bench, format_result
from bench.generated_cases import Case, draw_cases
from lupin_sim.host.prerequisites import missing_prerequisite

pytestmark = pytest.mark.host

SEED = 14
LAYERS = ("carrier", "ports", "loss", "login", "profile")


def first_single_fault(layer: str) -> Case:
    return next(case for case in draw_cases(SEED, layer) if len(case.faults) == 1)


def first_harmless_case() -> Case:
    return next(case for case in draw_cases(SEED) if not case.layers)


SAMPLE = (*map(first_single_fault, LAYERS), first_harmless_case())


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    if missing := missing_prerequisite():
        pytest.skip(missing)
    bench = Bench()
    yield bench
    bench.rig.stop()


@pytest.mark.parametrize("case", SAMPLE, ids=lambda case: f"{case.number}-{'-'.join(sorted(case.layers)) or 'harmless'}")
def test_doctor_is_right_about_generated_case(bench: Bench, case: Case) -> None:
    result = bench.measure(case, fix=False)
    assert result.error == "" and result.rebooted == ""
    assert result.judgement is not None and result.judgement.right, f"{format_result(result)}\n{result}"
