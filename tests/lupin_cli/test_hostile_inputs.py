"""Whatever a file or an argument holds, Lupin ends soon, with a message and without a traceback, and loses no file.

LUPIN_HOSTILE_INPUTS is the number of inputs; LUPIN_HOSTILE_ONLY repeats one of them.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from lupin_cli.exit_codes import USAGE_ERROR
from tests.support.hostile_inputs import hostile_input, valid_inputs

INPUTS = int(os.environ.get("LUPIN_HOSTILE_INPUTS", "5000"))
ONLY = os.environ.get("LUPIN_HOSTILE_ONLY", "")
SHOWN = 20
PART = 250  # inputs of one test, so that the processes that run tests share them
PARTS = [range(int(ONLY), int(ONLY) + 1)] if ONLY else [range(INPUTS)[at : at + PART] for at in range(0, INPUTS, PART)]


def test_samples_of_every_kind_are_read(tmp_path: Path) -> None:
    for given in valid_inputs(tmp_path):
        assert given.run() == ""
        assert given.status != USAGE_ERROR, given.printed


@pytest.mark.long
@pytest.mark.timeout(300)
@pytest.mark.parametrize("numbers", PARTS, ids=lambda numbers: f"{numbers[0]}-{numbers[-1]}")
def test_hostile_inputs_end_with_a_message(tmp_path: Path, numbers: Sequence[int]) -> None:
    failures = []
    for number in numbers:
        given = hostile_input(number, tmp_path)
        if problem := given.run():
            failures.append(f"{given}\n  {problem}")
        elif not ONLY:
            shutil.rmtree(given.folder)
    assert not failures, f"{len(failures)} of {len(numbers)} inputs:\n" + "\n".join(failures[:SHOWN])
