"""The graph of sentences allows what the grammar understands, however it is spelled, and neither a plain yes nor talk."""

from __future__ import annotations

import random

import pytest

from lupin_runtime.voice import sentence_graph
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.grammar import parse
from lupin_runtime.voice.sentence_graph import SentenceGraph, build_graph
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.utterance import Call, Confirmation
from tests.support.spoken_commands import COMMANDS, CONTEXT, NAMES, NO_MOTION


def letters(text: str) -> list[int]:
    return [ord(letter) for letter in text]


@pytest.fixture(scope="module")
def graph() -> SentenceGraph:
    return build_graph(ENGLISH, NAMES, letters)


def allows(graph: SentenceGraph, text: str) -> bool:
    states = graph.start
    for token in letters(f" {text}"):
        states = graph.follow(states, token)
    return graph.may_end(states)


# Words for stopping need no graph: they act wherever they are heard.
@pytest.mark.parametrize(
    "text", [text for text, (tool, _) in COMMANDS.items() if tool not in ("engage_estop", "speak", "arm_save_pose")]
)
def test_commands_are_allowed_as_a_recognizer_spells_them(graph: SentenceGraph, text: str) -> None:
    assert allows(graph, text) and allows(graph, f"{text.capitalize()}.")


@pytest.mark.parametrize(
    "text",
    [
        "Turn left 90 degrees.",
        "Turn left one hundred and eighty degrees.",
        "Turn right by 45 degrees.",
        "Gripper 40%.",
        "Go to X 2, Y -1.",
        "Go 1.5 meters forward.",
        "Drive forward at 0.2 meters per second for 1 second.",
        "Go to tag 5.",
        "Go to the sink, please.",
        "Please go home.",
        "LEDs red.",
        "Lights blue!",
        "No.",
    ],
)
def test_numbers_and_marks_are_allowed(graph: SentenceGraph, text: str) -> None:
    assert allows(graph, text)


def test_neither_a_yes_nor_talk_is_allowed(graph: SentenceGraph) -> None:
    assert [text for text in ("Yes.", "Do it.", "We confirm.", "") if allows(graph, text)] == []
    assert [text for text in NO_MOTION if allows(graph, text) and isinstance(parse(text, CONTEXT), Call)] == []


def test_random_sentences_of_the_graph_are_parsed(graph: SentenceGraph) -> None:
    """Most are commands; the others are out of range or incomplete. None is a yes."""
    draw = random.Random(1)
    understood = 0
    for _ in range(300):
        text, states = "", graph.start
        while not (graph.may_end(states) and draw.random() < 0.5):
            tokens = sorted(graph.allowed(states))
            if not tokens:
                break
            token = draw.choice(tokens)
            text, states = text + chr(token), graph.follow(states, token)
        result = parse(text, CONTEXT)
        assert not (isinstance(result, Confirmation) and result.agrees), text
        understood += isinstance(result, Call)
    assert understood > 100


def test_graph_keeps_a_bounded_number_of_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sentence_graph, "MAX_KEPT", 10)
    graph = build_graph(ENGLISH, NAMES, letters)
    assert all(allows(graph, text) for text in ("Turn left 90 degrees.", "Go 1.5 meters forward.", "Go to the sink, please."))
    assert max(len(graph._followed), len(graph._allowed)) <= 10


def test_of_new_words_only_usual_names_are_allowed(graph: SentenceGraph) -> None:
    assert all(allows(graph, f"save here as {name}") for name in ("kitchen", "row two", "row 12", "sink"))
    assert not any(allows(graph, text) for text in ("save here as mordor", "save here as row 20", "say hello"))


@pytest.mark.parametrize("name", ["zone ²", "room ①", "5²", "\ud800", "", "_", "x" * 300, "9" * 5000, "tag 007"])
def test_odd_name_does_no_harm(name: str) -> None:
    graph = build_graph(ENGLISH, Names(locations=(name, "sink")), letters)
    assert allows(graph, "go to sink")


def test_names_may_be_spelled_as_they_are_said() -> None:
    graph = build_graph(ENGLISH, Names(locations=("tag_12", "North-East corner")), letters)
    assert all(allows(graph, text) for text in ("go to tag 12", "go to tag twelve", "go to north east corner"))
    assert not allows(graph, "go to tag 11")
