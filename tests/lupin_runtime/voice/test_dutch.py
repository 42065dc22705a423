"""The grammar in Dutch: the same rules as in English, with other words."""

from __future__ import annotations

from typing import Any

import pytest

from lupin_runtime.voice import grammar
from lupin_runtime.voice.dutch import DUTCH
from lupin_runtime.voice.grammar import parse
from lupin_runtime.voice.rules import RULES
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.tools import BY_NAME, COLORS, Effect
from lupin_runtime.voice.utterance import Call, Confirmation, Context, Question

NAMES = Names(("home", "spoelbak", "tag 5"), ("hoge_stand",), ("water",))
CONTEXT = Context(NAMES, speed_cap=0.5)
COMMANDS: dict[str, tuple[str, dict[str, Any]]] = {
    "Rij vooruit met 0,2 meter per seconde voor een seconde": ("drive", {"linear_x": 0.2, "duration_s": 1.0}),
    "draai naar links met dertig graden per seconde voor een halve seconde": (
        "drive",
        {"angular_z": 0.523599, "duration_s": 0.5},
    ),
    "sta stil": ("stop", {}),
    "ga naar x anderhalve y min twee": ("nav_goto", {"x": 1.5, "y": -2.0}),
    "ga twee meter vooruit": ("nav_forward", {"forward_m": 2.0}),
    "rij vijftig centimeter achteruit": ("nav_forward", {"forward_m": -0.5}),
    "ga een meter naar rechts": ("nav_forward", {"lateral_m": -1.0}),
    "draai vijfenveertig graden naar rechts": ("rotate", {"angle_deg": -45.0}),
    "draai honderdtachtig graden linksom": ("rotate", {"angle_deg": 180.0}),
    "keer om": ("rotate", {"angle_deg": 180.0}),
    "snelheidslimiet vijftig procent": ("set_speed_cap", {"value": 0.5}),
    "langzamer": ("set_speed_cap", {"value": 0.25}),
    "annuleer de navigatie": ("nav_cancel", {}),
    "ga naar de spoelbak": ("nav_goto_named", {"name": "spoelbak"}),
    "ga naar tag vijf": ("nav_goto_named", {"name": "tag 5"}),
    "welke locaties zijn er": ("list_named_locations", {}),
    "bewaar deze plek als kas twee": ("save_named_location", {"name": "kas 2"}),
    "open de grijper": ("gripper", {"action": "open"}),
    "grijper veertig procent": ("gripper", {"action": "set", "percent": 40.0}),
    "arm naar home": ("arm_preset", {"name": "home"}),
    "beweeg de arm naar hoge stand": ("arm_goto_pose", {"name": "hoge_stand"}),
    "bewaar de armstand als laag": ("arm_save_pose", {"name": "laag"}),
    "noem de sequenties": ("arm_list_library", {}),
    "speel water af op halve snelheid": ("arm_run_sequence", {"name": "water", "speed": 0.5}),
    "houd de arm stil": ("arm_stop", {}),
    "start een kinesthetische opname": ("arm_record", {"action": "start", "mode": "kinesthetic"}),
    "kalibreer de arm": ("calibrate_arm", {"action": "start"}),
    "schrijf de kalibratie": ("calibrate_arm", {"action": "commit"}),
    "hoe vol is de accu": ("query_state", {"fields": ["battery"]}),
    "noodstop": ("engage_estop", {}),
    "zeg goedemorgen": ("speak", {"text": "goedemorgen"}),
    "maak de lampen paars": ("set_light", {"color": "purple"}),
    "lichten automatisch": ("set_light", {"mode": "auto"}),
}  # fmt: skip


def test_commands_are_understood() -> None:
    wrong = {text: result for text, expected in COMMANDS.items() if (result := parse(text, CONTEXT, DUTCH)) != Call(*expected)}
    assert wrong == {}
    assert {tool for tool, _ in COMMANDS.values()} == set(BY_NAME)


@pytest.mark.parametrize(
    "text",
    [
        "rij niet",
        "ga niet naar de spoelbak",
        "kun je rijden?",
        "ze zei ga naar de spoelbak",
        "ga naar de spoelbak?",
        "ga naar de spoelbak en open de grijper",
        "ga tweehonderd meter vooruit",
        "ga vooruit",
        "lekker weer vandaag",
        "draai om de hoek",
    ],
)
def test_other_sentences_are_questions(text: str) -> None:
    assert isinstance(parse(text, CONTEXT, DUTCH), Question)


@pytest.mark.parametrize("text", ["stop", "halt", "nee", "nee niet doen", "ga naar de spoelbak, nee, stop"])
def test_words_for_stopping_stop(text: str) -> None:
    assert parse(text, CONTEXT, DUTCH) == Call("engage_estop")


def test_answers_to_a_read_back() -> None:
    context = Context(NAMES, pending=Call("rotate", {"angle_deg": 90.0}))
    assert parse("ja graag", context, DUTCH) == parse("doe maar", context, DUTCH) == Confirmation(True)
    assert parse("laat maar", context, DUTCH) == Confirmation(False)
    assert parse("ja", CONTEXT, DUTCH) == Question(grammar.NOTHING_PENDING)


def test_tables_are_complete() -> None:
    assert set(DUTCH.phrases) == set(RULES)
    assert set(DUTCH.choices["color"].values()) == set(COLORS)


@pytest.mark.parametrize("example", DUTCH.examples)
def test_example_is_understood(example: str) -> None:
    names = Names(locations=("LOCATION",), poses=("NAME",), sequences=("NAME",))
    assert isinstance(parse(example, Context(names), DUTCH), Call)


@pytest.mark.parametrize("word", ["niet", "ze", "als", "misschien", "waarom", "en"])
def test_word_before_a_motion_keeps_it_from_being_made(word: str) -> None:
    motions = [text for text, (tool, _) in COMMANDS.items() if BY_NAME[tool].effect is Effect.MOTION]
    assert [text for text in motions if not isinstance(parse(f"{word} {text}", CONTEXT, DUTCH), Question)] == []
