"""The grammar understands what people say, and asks again instead of guessing a motion."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.voice import grammar, rules
from lupin_runtime.voice.arguments import Kind
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.grammar import has_stop_word, is_doubtful_stop, parse
from lupin_runtime.voice.rules import RULES
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.tools import BY_NAME, TOOLS, Effect
from lupin_runtime.voice.utterance import Call, Confirmation, Context, Question
from tests.support.spoken_commands import COMMANDS, CONTEXT, NAMES, NO_MOTION

HOMOPHONES = {
    "to": "two", "two": "to", "for": "four", "four": "for", "one": "won", "eight": "ate", "metre": "meets her",
    "metres": "meters", "right": "write", "gripper": "grip her", "sink": "sync", "blue": "blew", "here": "hear", "by": "buy",
}  # fmt: skip
STOPPING = (
    "stop", "Stop!", "STOP", "halt", "nee", "do not stop", "she said stop", "go to the sink stop", "can you stop?", "e stop",
    "robot stop now", '"stop"', "stop and go to the sink", "go to the bus stop", "save here as stop", "say stop", "Nee, nee.",
    "go to the sink nose top",
)  # fmt: skip
READ_BACK = Call("rotate", {"angle_deg": 90.0})


def moves(result: Call | Confirmation | Question) -> bool:
    return isinstance(result, Call) and BY_NAME[result.tool].effect is Effect.MOTION


def test_sixty_commands_are_understood() -> None:
    assert len(COMMANDS) == 60
    wrong = {text: result for text, expected in COMMANDS.items() if (result := parse(text, CONTEXT)) != Call(*expected)}
    assert wrong == {}


def test_sixty_other_sentences_make_no_motion() -> None:
    assert len(set(NO_MOTION)) == 60
    assert {text: result for text in NO_MOTION if not isinstance(result := parse(text, CONTEXT), Question)} == {}


def test_every_tool_and_argument_can_be_reached() -> None:
    reached: dict[str, set[str]] = {}
    for tool, arguments in COMMANDS.values():
        reached.setdefault(tool, set()).update(arguments)
    assert reached == {tool.name: {argument.name for argument in tool.arguments} for tool in TOOLS}


def test_every_choice_can_be_reached() -> None:
    said = [
        *(f"lights {color}" for color in ENGLISH.choices["color"]),
        *(f"arm {name}" for name in NAMES.of("preset")),
        "what is the battery", "where are you", "is the e-stop engaged", "start a teleop recording",
    ]  # fmt: skip
    calls = [*(Call(*expected) for expected in COMMANDS.values()), *(parse(text, CONTEXT) for text in said)]
    chosen = {
        (call.tool, name, value)
        for call in calls
        if isinstance(call, Call)
        for name, values in call.arguments.items()
        for value in (values if isinstance(values, list) else [values])
    }
    wanted = {
        (tool.name, argument.name, choice)
        for tool in TOOLS
        for argument in tool.arguments
        if argument.kind in (Kind.CHOICE, Kind.CHOICES)
        for choice in argument.choices
    }
    assert wanted - chosen == set()


def test_every_rule_has_phrases_and_every_phrase_a_rule() -> None:
    assert set(ENGLISH.phrases) == set(RULES)


@pytest.mark.parametrize("example", ENGLISH.examples)
def test_example_is_understood(example: str) -> None:
    names = Names(locations=("LOCATION",), poses=("NAME",), sequences=("NAME",))
    assert isinstance(parse(example, Context(names)), Call)


@pytest.mark.parametrize(
    ("text", "tool", "arguments"),
    [
        ("where is the robot", "query_state", {"fields": ["pose"]}),
        ("bring the robot back home", "nav_goto_named", {"name": "home"}),
        ("record a new sequence called hello", "arm_record", {"action": "start", "name": "hello"}),
        ("remember here as the corner", "save_named_location", {"name": "corner"}),
        ("What is the calibration status?", "calibrate_arm", {"action": "status"}),
        ("rotate sixty degrees anticlockwise", "rotate", {"angle_deg": 60.0}),
    ],
)
def test_other_wording_is_understood(text: str, tool: str, arguments: dict[str, object]) -> None:
    assert parse(text, CONTEXT) == Call(tool, arguments)


def test_direction_that_was_cut_is_asked_again() -> None:
    # "Anticlockwise" is heard as "to clockwise".
    assert isinstance(parse("rotate sixty degrees to clockwise", CONTEXT), Question)


@pytest.mark.parametrize("text", STOPPING)
def test_stop_word_stops_wherever_it_stands(text: str) -> None:
    assert parse(text, CONTEXT) == Call("engage_estop")
    assert has_stop_word(text)


@pytest.mark.parametrize("text", ["those top and remove the", "it's top on the list"])
def test_top_inside_a_text_is_a_doubtful_stop(text: str) -> None:
    assert has_stop_word(text) and is_doubtful_stop(text)


@pytest.mark.parametrize("text", ["nose top", "please top the robot", "those top and stop", "top it", ""])
def test_clear_stop_is_not_doubtful(text: str) -> None:
    assert not is_doubtful_stop(text)


@pytest.mark.parametrize("text", ["the stopper", "nonstop", "it stopped", "halting", "need", "is the e-stop engaged"])
def test_other_words_do_not_stop(text: str) -> None:
    assert not has_stop_word(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("yes", Confirmation(True)),
        ("Yes, please.", Confirmation(True)),
        ("go ahead", Confirmation(True)),
        ("no", Confirmation(False)),
        ("no, don't", Confirmation(False)),
        ("cancel", Confirmation(False)),
        ("commit", Call("calibrate_arm", {"action": "commit"})),
        ("turn left 45 degrees", Call("rotate", {"angle_deg": 45.0})),
        ("stop", Call("engage_estop")),
    ],
)
def test_sentence_after_a_read_back(text: str, expected: object) -> None:
    assert parse(text, Context(NAMES, pending=READ_BACK)) == expected


@pytest.mark.parametrize("text", ["yes?", "okay", "thank you", "maybe", "yes but turn right", '"yes"', "not yes", "yes no"])
def test_unclear_answer_confirms_nothing(text: str) -> None:
    assert isinstance(parse(text, Context(NAMES, pending=READ_BACK)), Question)


@pytest.mark.parametrize("text", ["commit", "I have moved the arm", "yes", "go ahead"])
def test_commit_of_a_calibration_is_confirmed(text: str) -> None:
    pending = Call("calibrate_arm", {"action": "commit"})
    assert parse(text, Context(NAMES, pending=pending)) == Confirmation(True)


@pytest.mark.parametrize("text", ["yes", "no", "go ahead", "never mind"])
def test_answer_without_a_read_back_is_a_question(text: str) -> None:
    assert parse(text, CONTEXT) == Question(grammar.NOTHING_PENDING)


@pytest.mark.parametrize("running", ["calibrate_arm", "arm_record"])
def test_cancel_ends_what_was_started(running: str) -> None:
    assert parse("cancel that", Context(NAMES, running=running)) == Call(running, {"action": "cancel"})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("don't drive", grammar.NEGATION),
        ("go to the sink?", grammar.ASKED),
        ('"go to the sink"', grammar.QUOTED),
        ("go to the sink and open the gripper", grammar.TWO_COMMANDS),
        ("what a lovely day", grammar.UNKNOWN),
        ("", grammar.NOTHING),
        ("um, okay", grammar.NOTHING),
        ("blah " * 100, grammar.TOO_LONG),
        ("go forward", rules.HOW_FAR),
        ("go two metres", rules.WHICH_WAY),
        ("turn left", rules.WHICH_ANGLE),
        ("go minus two metres forward", rules.SIGNED_TWICE),
        ("drive forward at 0.2 m/s for 3 s", rules.BURST_RANGE),
        ("drive forward at 20 m/s for 1 s", rules.SPEED_RANGE),
        ("release the e-stop", rules.RELEASED_BY_HAND),
        ("gripper 120 percent", "percent must be a number from 0 to 100 %, not 120.0"),
        ("go to the sofa", "there is no location 'sofa'; there are: home, sink, door, charging station, tag 5, tag_6"),
        ("go to tag 7", "there is no location 'tag 7'; there are: home, sink, door, charging station, tag 5, tag_6"),
        ("faster", rules.AT_MAXIMUM),
    ],
)
def test_question_says_what_is_wrong(text: str, reason: str) -> None:
    question = parse(text, Context(NAMES))
    assert isinstance(question, Question) and question.reason == reason


@pytest.mark.parametrize(
    "text", ["e-stop", "the emergency", "Press the E-Stop!", "go to the sink estop", "hit that e-stop", "Hold."]
)
def test_sentence_that_may_stop_or_read_stops(text: str) -> None:
    assert parse(text, CONTEXT) == Call("engage_estop")


def test_state_of_the_estop_is_read_without_engaging_it() -> None:
    assert parse("Is the E-stop engaged?", CONTEXT) == Call("query_state", {"fields": ["estop"]})


def test_question_names_the_nearest_sentences() -> None:
    question = parse("gripper fourty per", CONTEXT)
    assert isinstance(question, Question) and "gripper forty percent" in question.nearest


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("go too meets her forward", Call("nav_forward", {"forward_m": 2.0})),
        ("go for metres forward", Call("nav_forward", {"forward_m": 4.0})),
        ("go four two metres forward", Call("nav_forward", {"forward_m": 2.0})),
        ("drive forward 0.2 meters per second four won second", Call("drive", {"linear_x": 0.2, "duration_s": 1.0})),
        ("turn write ninety degrees", Call("rotate", {"angle_deg": -90.0})),
        ("open the grip her", Call("gripper", {"action": "open"})),
        ("Lights, blew.", Call("set_light", {"color": "blue"})),
        ("go to the sync", Call("nav_goto_named", {"name": "sink"})),
        ("go two the sink", Call("nav_goto_named", {"name": "sink"})),
        ("safe hear as kitchen", Call("save_named_location", {"name": "kitchen"})),
    ],
)
def test_homophones_of_recognizers_are_understood(text: str, expected: Call) -> None:
    assert parse(text, CONTEXT) == expected


def mutations(text: str) -> list[str]:
    words = text.split()
    dropped = [[*words[:index], *words[index + 1 :]] for index in range(len(words))]
    swapped = [[*words[:i], words[i + 1], words[i], *words[i + 2 :]] for i in range(len(words) - 1)]
    replaced = [[*words[:i], HOMOPHONES[word], *words[i + 1 :]] for i, word in enumerate(words) if word in HOMOPHONES]
    doubled = [[*words[:index], words[index], *words[index:]] for index in range(len(words))]
    return [" ".join(each) for each in itertools.chain(dropped, swapped, replaced, doubled)]


def test_damaged_command_never_becomes_another_motion() -> None:
    wrong = {
        (text, damaged): result
        for text, (tool, _) in COMMANDS.items()
        for damaged in mutations(text)
        if moves(result := parse(damaged, CONTEXT))
        if isinstance(result, Call) and result.tool != tool
    }
    assert wrong == {}


def test_damaged_motion_never_changes_its_direction() -> None:
    signed = {text: expected for text, expected in COMMANDS.items() if any(_signs(expected[1]))}
    wrong = {
        (text, damaged): result
        for text, (tool, arguments) in signed.items()
        for damaged in mutations(text)
        if isinstance(result := parse(damaged, CONTEXT), Call) and result.tool == tool
        if any(_signs(result.arguments).get(name, sign) != sign for name, sign in _signs(arguments).items())
    }
    # A sign that was not heard cannot be missed: such a goal is read back.
    assert set(wrong) == {("go to x two y minus one", "go to x two y one")}


def _signs(arguments: object) -> dict[str, bool]:
    assert isinstance(arguments, dict)
    return {name: value < 0 for name, value in arguments.items() if isinstance(value, float) and name != "yaw"}


def test_damaged_talk_makes_no_motion() -> None:
    # A word that is dropped may be the negation itself; all other damage must not make a motion of talk.
    wrong = {
        damaged: result
        for text in NO_MOTION
        for damaged in mutations(text)
        if len(damaged.split()) >= len(text.split())
        if moves(result := parse(damaged, CONTEXT))
    }
    assert wrong == {}


def test_words_around_a_motion_keep_it_from_being_made() -> None:
    words = ("she", "said", "can", "not", "don't", "if", "when", "maybe", "tomorrow", "and", "then", "why", "they", "should")
    # A new name may have any words, and is read back or harmless.
    motions = [text for text, (tool, _) in COMMANDS.items() if BY_NAME[tool].effect is Effect.MOTION and "dance" not in text]
    wrong = [
        said
        for text, word in itertools.product(motions, words)
        for said in (f"{word} {text}", f"{text} {word}")
        if moves(parse(said, CONTEXT))
    ]
    assert wrong == []


VOCABULARY = sorted({word for text in (*COMMANDS, *NO_MOTION) for word in text.split()} | set(HOMOPHONES.values()))


@given(st.lists(st.sampled_from(VOCABULARY), max_size=12), st.booleans())
def test_any_words_make_at_most_a_valid_call(words: list[str], has_pending: bool) -> None:
    result = parse(" ".join(words), Context(NAMES, pending=READ_BACK if has_pending else None))
    if isinstance(result, Call):
        BY_NAME[result.tool].check(dict(result.arguments))


@given(st.text(max_size=200))
def test_any_text_makes_at_most_a_valid_call(text: str) -> None:
    result = parse(text, CONTEXT)
    if isinstance(result, Call):
        BY_NAME[result.tool].check(dict(result.arguments))


def test_random_words_of_commands_rarely_move() -> None:
    draw = random.Random(1)
    said = [" ".join(draw.choices(VOCABULARY, k=draw.randint(2, 8))) for _ in range(500)]
    assert sum(moves(parse(text, CONTEXT)) for text in said) <= 3
