"""Every parser on captured output: `captured/<fact>/<case>.txt` is the output of the probe, `<case>.json` the expected value.

To add a case, save the output, let the parser write the value with `LUPIN_WRITE_VALUES=1 pytest tests/lupin_cli/facts`, and
review it.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import pkgutil
from pathlib import Path
from typing import Any

import pytest

import lupin_cli.facts
from lupin_cli.connection import Output
from lupin_cli.facts import Fact
from lupin_cli.facts.dds_profiles import parse_profile

CAPTURED = Path(__file__).parent / "captured"
MODULES = [importlib.import_module(f"lupin_cli.facts.{each.name}") for each in pkgutil.iter_modules(lupin_cli.facts.__path__)]
FACTS = {value.name: value for module in MODULES for value in vars(module).values() if isinstance(value, Fact)}
CASES = sorted(CAPTURED.glob("*/*.txt"))


def plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, frozenset | set):
        return sorted(plain(each) for each in value)
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    return value


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.parent.name}/{case.stem}")
def test_captured_output_parses_to_expected_value(case: Path) -> None:
    value = plain(FACTS[case.parent.name].parse(Output(0, case.read_text())))
    expected = case.with_suffix(".json")
    if os.environ.get("LUPIN_WRITE_VALUES") == "1" and not expected.exists():
        expected.write_text(json.dumps(value, indent=1, ensure_ascii=False) + "\n")
    assert value == json.loads(expected.read_text())


def test_every_fact_has_a_captured_output() -> None:
    assert set(FACTS) == {case.parent.name for case in CASES}


@pytest.mark.parametrize("name", sorted(FACTS))
def test_garbage_parses_to_value_or_raises_value_error(name: str) -> None:
    for text in ("", "\n", "garbage", "a: b\n\x00\xff", "== x\n1 2 3\n" * 3, "-" * 10_000):
        try:
            FACTS[name].parse(Output(0, text))
        except ValueError as error:
            assert str(error)


def test_profile_with_invalid_utf8_has_an_error() -> None:
    assert "not well-formed" in parse_profile("profile.xml", "<dds>\udce4</dds>").error


def test_lock_of_another_file_system_holds_no_file() -> None:
    text = "@@ files\n4 0 9 1 fastrtps_00aa\n5 0 0 1 fastrtps_00aa_el\n@@ device\n1b\n@@ locks\n"
    text += "1: FLOCK  ADVISORY  WRITE 777 00:{device}:5 0 EOF\n@@ tried\n{tried} fastrtps_00aa_el\n@@ end\n"
    of_a_container = FACTS["shared-memory"].parse(Output(0, text.format(device="3f", tried="free")))
    assert {(file.held, file.holder) for file in of_a_container} == {(False, 0)}
    own = FACTS["shared-memory"].parse(Output(0, text.format(device="1b", tried="held")))
    assert {(file.held, file.holder) for file in own} == {(True, 777)}
