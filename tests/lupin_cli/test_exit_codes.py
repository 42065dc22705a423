"""The numbers are part of the command line's interface: scripts compare them."""

from __future__ import annotations

from lupin_cli import exit_codes


def test_exit_codes_keep_their_numbers() -> None:
    numbers = {name: value for name, value in vars(exit_codes).items() if name.isupper()}
    assert numbers == {
        "SUCCESS": 0,
        "FAILURE": 1,
        "USAGE_ERROR": 2,
        "UNREACHABLE": 3,
        "NO_RESULT": 4,
        "INTERNAL_ERROR": 70,
        "INTERRUPTED": 130,
    }


def test_worst_prefers_interrupted_then_unreachable() -> None:
    assert exit_codes.worst([0, 1, 3, 130]) == 130
    assert exit_codes.worst([0, 1, 3]) == 3
    assert exit_codes.worst([0, 1]) == 1
    assert exit_codes.worst([0, 0]) == exit_codes.worst([]) == 0
