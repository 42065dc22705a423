"""A command is outdated by every stop, release and handover after it, and by nothing else."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.command_era import OUTDATED, CommandEra

STEPS = st.one_of(st.tuples(st.just("stop"), st.booleans()), st.tuples(st.just("holder"), st.sampled_from(["a", "b", None])))


def test_command_is_outdated_by_a_stop_and_its_release() -> None:
    era = CommandEra(lambda: 0)
    before = era.refusal()
    era.note_stop(False)
    assert before() == ""
    era.note_stop(True)
    meanwhile = era.refusal()
    assert before() == OUTDATED and meanwhile() == ""
    era.note_stop(False)
    assert before() == meanwhile() == OUTDATED
    assert era.refusal()() == ""


def test_command_is_outdated_by_the_next_holder_of_control() -> None:
    era = CommandEra(lambda: 0)
    era.note_holder("a")
    command = era.refusal()
    era.note_holder("a")
    era.note_holder(None)
    assert command() == "", "its sender may have disconnected"
    era.note_holder("b")
    assert command() == OUTDATED


def test_command_is_outdated_by_a_stop_of_other_origin() -> None:
    changes = [0]
    command = CommandEra(lambda: changes[0]).refusal()
    assert command() == ""
    changes[0] = 2  # the button was pressed and released
    assert command() == OUTDATED


@given(st.lists(STEPS, max_size=20), st.lists(STEPS, max_size=20))
def test_command_is_valid_only_while_stop_and_control_stay(
    before: list[tuple[str, bool | str | None]], after: list[tuple[str, bool | str | None]]
) -> None:
    era = CommandEra(lambda: 0)
    stopped, holder, changed, command = False, None, False, None
    for number, (kind, value) in enumerate((*before, *after)):
        if number == len(before):
            changed, command = False, era.refusal()
        if kind == "stop":
            changed |= value != stopped
            stopped = bool(value)
            era.note_stop(stopped)
        else:
            name = value if isinstance(value, str) else None
            changed |= name is not None and name != holder
            holder = name or holder
            era.note_holder(name)
        assert command is None or bool(command()) is changed
