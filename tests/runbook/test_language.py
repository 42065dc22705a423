# ruff: noqa: E501 - one fault a line
"""A bad playbook is refused with file, line, column and the nearest valid word; a good one means what it says."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.runbook import Playbook, PlaybookError, load
from lupin_cli.runbook.source import Source

FILE = "file: {path: /tmp/x, content: hello}"

# what is wrong: (body, line:column of the whole file, words of the message)
REFUSED = {
    "an unknown key of the playbook": ("step: []\nsteps: []", "3:1", "no key 'step'; the nearest is 'steps'"),
    "no steps": ("vars: {}", "1:1", "needs 'steps'"),
    "an empty list of steps": ("steps: []", "3:8", "at least one step"),
    "steps that are no list": ("steps: 3", "3:8", "is a list, not a number"),
    "an unknown operation": ("steps:\n- name: A\n  symlnk: {path: /a, to: /b}", "5:3", "'symlnk'; the nearest is 'symlink'"),
    "an unknown argument": ("steps:\n- name: A\n  file: {pth: /a}", "5:10", "no argument 'pth'; the nearest is 'path'"),
    "a missing argument": ("steps:\n- name: A\n  file: {content: x}", "5:3", "needs the argument 'path'"),
    "an argument of the wrong type": ("steps:\n- name: A\n  file: {path: /a, mode: 644}", "5:26", 'found 644; put it in quotes: "644"'),
    "an argument that the operation won't have": ('steps:\n- name: A\n  file: {path: /a, mode: "9"}', "5:3", "three octal digits"),
    "two operations": (f"steps:\n- name: A\n  {FILE}\n  probe: {{run: ls}}", "6:3", "exactly one operation; found file and probe"),
    "no operation": ("steps:\n- name: A", "4:3", "found none"),
    "no name": (f"steps:\n- {FILE}", "4:3", "needs a 'name'"),
    "a name twice": (f"steps:\n- name: A\n  {FILE}\n- name: A\n  {FILE}", "6:9", "two steps are named 'A'; first in line 4"),
    "a key twice": (f"steps:\n- name: A\n  {FILE}\n  name: B", "6:3", "'name' stands twice in a step; first in line 4"),
    "an unknown machine": (f"steps:\n- name: A\n  on: labtop\n  {FILE}", "5:7", "'labtop'; the nearest is 'laptop'"),
    "an undefined variable": ("steps:\n- name: A\n  file: {path: '{{ hme }}/a'}", "5:16", "'hme' is neither a variable"),
    "an undefined variable in a condition": (f"vars: {{home: /}}\nsteps:\n- name: A\n  when: 1 == hme\n  {FILE}", "6:14", "the nearest is 'home'"),
    "an unknown value of a result": (
        f"steps:\n- name: A\n  as: a\n  probe: {{run: ls}}\n- name: B\n  when: a.stauts == 0\n  {FILE}", "8:9", "the nearest is 'status'"
    ),
    "a result that comes later": (f"steps:\n- name: A\n  when: b.changed\n  {FILE}\n- name: B\n  as: b\n  {FILE}", "5:9", "earlier step"),
    "a condition that is none": (f"steps:\n- name: A\n  when: 1 = 2\n  {FILE}", "5:11", "equality is written =="),
    "a hole that is never closed": ("steps:\n- name: A\n  file: {path: '/{{ a'}", "5:18", "never closed"),
    "an unknown type": ("vars: {a: {type: adress}}\nsteps: []", "3:18", "the nearest is 'address'"),
    "a default of the wrong type": ("vars: {a: {type: address, default: 10.42.0.300}}\nsteps: []", "3:36", "expected an IPv4 address"),
    "a default that isn't a choice": ("vars: {a: {choices: [x, y], default: z}}\nsteps: []", "3:38", "one of x, y"),
    "a time-out that is no number": (f"steps:\n- name: A\n  timeout: soon\n  {FILE}", "5:12", "number of seconds"),
    "retries below nothing": (f"steps:\n- name: A\n  retry: -1\n  {FILE}", "5:10", "from 0 to 100"),
    "an unknown key of retry": (f"steps:\n- name: A\n  retry: {{time: 2}}\n  {FILE}", "5:11", "the nearest is 'times'"),
    "undo that is no truth": (f"steps:\n- name: A\n  undo: no\n  {FILE}", "5:9", "expected true or false, found 'no'"),
    "an include that isn't there": ("steps:\n- include: swep", "4:12", "there is no playbook 'swep'"),
    "a command without a guard": ("steps:\n- name: A\n  command: {run: ls}", "5:3", "it needs a guard"),
    "an alias": ("steps:\n- &a\n  name: A\n- *a", "6:3", "aliases (*name) are not allowed"),
    "a tag": ("steps:\n- name: !!python/name:os.system A\n  " + FILE, "4:9", "is not allowed"),
    "a tab": ("steps:\n\t- name: A", "4:1", "is not YAML"),
    "a bracket that stays open": ("steps: [", "3:9", "is not YAML"),
    "a second document": ("steps: []\n---\nsteps: []", "4:1", "is not YAML"),
}  # fmt: skip


@pytest.mark.parametrize("fault", REFUSED)
def test_a_fault_is_refused_at_its_place(fault: str, written: Callable[..., Path]) -> None:
    body, place, words = REFUSED[fault]
    path = written(body)
    with pytest.raises(PlaybookError) as refused:
        load(path)
    assert str(refused.value).startswith(f"{path}:{place}: "), str(refused.value)
    assert words in str(refused.value)


def test_the_name_is_the_files(tmp_path: Path) -> None:
    path = tmp_path / "one.yaml"
    path.write_text("name: two\ndescription: x\nsteps: []")
    with pytest.raises(PlaybookError, match=r"one.yaml:1:7: the name is 'two'"):
        load(path)


def test_an_include_that_comes_back_is_a_circle(written: Callable[..., Path]) -> None:
    written("steps:\n- include: second", "first")
    written("steps:\n- include: third", "second")
    written("steps:\n- include: first", "third")
    with pytest.raises(PlaybookError, match=r"third.yaml:4:12: includes itself: first → second → third → first"):
        load(written("steps:\n- include: second", "first"))


def test_an_include_gets_only_variables_that_it_has(written: Callable[..., Path]) -> None:
    written(f"vars: {{port: 1}}\nsteps:\n- name: A\n  {FILE}", "inner")
    with pytest.raises(PlaybookError, match=r"outer.yaml:5:15: 'inner' has no variable 'prt'; the nearest is 'port'"):
        load(written("steps:\n- include: inner\n  vars: {prt: 3}", "outer"))


def test_an_include_needs_what_has_no_default(written: Callable[..., Path]) -> None:
    written(f"vars: {{port: {{type: integer}}}}\nsteps:\n- name: A\n  {FILE}", "inner")
    with pytest.raises(PlaybookError, match=r"outer.yaml:4:12: 'inner' needs the variable 'port'"):
        load(written("steps:\n- include: inner", "outer"))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is empty"),
        (b"name: \xff", "1:7: is not UTF-8 here"),
        (b"[" * 100_000, "more than 20 deep"),
        (b"#" * 300_000, "at most"),
    ],
)
def test_what_is_no_text_of_a_playbook_is_refused(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "book.yaml"
    path.write_bytes(data)
    with pytest.raises(PlaybookError) as refused:
        load(path)
    assert re.search(words, str(refused.value)), str(refused.value)


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PlaybookError, match="cannot be read: Is a directory"):
        load(tmp_path)


def test_words_that_older_yaml_takes_for_truth_stay_words(loaded: Callable[..., Playbook]) -> None:
    book = loaded("vars: {a: off, b: 10:30, c: 0644, d: yes}\nsteps:\n- name: A\n  on: laptop\n  file: {path: /a, content: on}")
    assert [variable.default for variable in book.variables] == ["off", "10:30", 644, "yes"]
    assert book.steps[0].arguments["content"][0] == "on"


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        Source("x.yaml", text)
    except PlaybookError as error:
        assert str(error).startswith("x.yaml")
