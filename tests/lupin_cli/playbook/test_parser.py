# ruff: noqa: E501 - one mistake per line
"""A bad playbook is refused with file, line, column and the most similar valid word."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.playbook import Playbook, PlaybookError, load
from lupin_cli.playbook.yaml_source import YamlSource

FILE = "file: {path: /tmp/x, content: hello}"

# mistake: (body, line:column in the file, part of the message)
REFUSED = {
    "an unknown key of the playbook": ("step: []\nsteps: []", "3:1", "no key 'step'; did you mean 'steps'"),
    "no steps": ("vars: {}", "1:1", "needs 'steps'"),
    "an empty list of steps": ("steps: []", "3:8", "at least one step"),
    "steps that are not a list": ("steps: 3", "3:8", "is a list, not a number"),
    "an unknown operation": ("steps:\n- name: A\n  symlnk: {path: /a, to: /b}", "5:3", "'symlnk'; did you mean 'symlink'"),
    "an unknown argument": ("steps:\n- name: A\n  file: {pth: /a}", "5:10", "no argument 'pth'; did you mean 'path'"),
    "a missing argument": ("steps:\n- name: A\n  file: {content: x}", "5:3", "needs the argument 'path'"),
    "an argument of the wrong type": ("steps:\n- name: A\n  file: {path: /a, mode: 644}", "5:26", 'found 644; put it in quotes: "644"'),
    "an invalid argument": ('steps:\n- name: A\n  file: {path: /a, mode: "9"}', "5:3", "three octal digits"),
    "two operations": (f"steps:\n- name: A\n  {FILE}\n  probe: {{run: ls}}", "6:3", "exactly one operation; found file and probe"),
    "no operation": ("steps:\n- name: A", "4:3", "found none"),
    "no name": (f"steps:\n- {FILE}", "4:3", "needs a 'name'"),
    "a name twice": (f"steps:\n- name: A\n  {FILE}\n- name: A\n  {FILE}", "6:9", "two steps are named 'A'; first in line 4"),
    "a key twice": (f"steps:\n- name: A\n  {FILE}\n  name: B", "6:3", "'name' is in a step twice; first in line 4"),
    "an unknown machine": (f"steps:\n- name: A\n  on: labtop\n  {FILE}", "5:7", "'labtop'; did you mean 'laptop'"),
    "an undefined variable": ("steps:\n- name: A\n  file: {path: '{{ hme }}/a'}", "5:16", "'hme' is neither a variable"),
    "an undefined variable in a condition": (f"vars: {{home: /}}\nsteps:\n- name: A\n  when: 1 == hme\n  {FILE}", "6:14", "did you mean 'home'"),
    "an unknown value of a result": (
        f"steps:\n- name: A\n  as: a\n  probe: {{run: ls}}\n- name: B\n  when: a.stauts == 0\n  {FILE}", "8:9", "did you mean 'status'"
    ),
    "a result that comes later": (f"steps:\n- name: A\n  when: b.changed\n  {FILE}\n- name: B\n  as: b\n  {FILE}", "5:9", "earlier step"),
    "an invalid condition": (f"steps:\n- name: A\n  when: 1 = 2\n  {FILE}", "5:11", "equality is written =="),
    "a template that is never closed": ("steps:\n- name: A\n  file: {path: '/{{ a'}", "5:18", "never closed"),
    "an unknown type": ("vars: {a: {type: adress}}\nsteps: []", "3:18", "did you mean 'address'"),
    "a default of the wrong type": ("vars: {a: {type: address, default: 10.42.0.300}}\nsteps: []", "3:36", "expected an IPv4 address"),
    "a default that isn't a choice": ("vars: {a: {choices: [x, y], default: z}}\nsteps: []", "3:38", "one of x, y"),
    "a timeout that is not a number": (f"steps:\n- name: A\n  timeout: soon\n  {FILE}", "5:12", "number of seconds"),
    "negative retries": (f"steps:\n- name: A\n  retry: -1\n  {FILE}", "5:10", "from 0 to 100"),
    "an unknown key of retry": (f"steps:\n- name: A\n  retry: {{time: 2}}\n  {FILE}", "5:11", "did you mean 'times'"),
    "undo that is not a truth value": (f"steps:\n- name: A\n  undo: no\n  {FILE}", "5:9", "expected true or false, found 'no'"),
    "a tag that is no word": (f"steps:\n- name: A\n  tags: ['a b']\n  {FILE}", "5:10", "cannot be a tag"),
    "tags that are no list": (f"steps:\n- name: A\n  tags: a\n  {FILE}", "5:9", "is a list"),
    "an include that does not exist": ("steps:\n- include: swep", "4:12", "there is no playbook 'swep'"),
    "a command without a guard": ("steps:\n- name: A\n  command: {run: ls}", "5:3", "it needs a guard"),
    "an alias": ("steps:\n- &a\n  name: A\n- *a", "6:3", "aliases (*name) are not allowed"),
    "a tag": ("steps:\n- name: !!python/name:os.system A\n  " + FILE, "4:9", "is not allowed"),
    "a tab": ("steps:\n\t- name: A", "4:1", "is not YAML"),
    "a bracket that is never closed": ("steps: [", "3:9", "is not YAML"),
    "a second document": ("steps: []\n---\nsteps: []", "4:1", "is not YAML"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", REFUSED)
def test_mistake_is_refused_at_its_place(mistake: str, write_playbook: Callable[..., Path]) -> None:
    body, place, words = REFUSED[mistake]
    path = write_playbook(body)
    with pytest.raises(PlaybookError) as refused:
        load(path)
    assert str(refused.value).startswith(f"{path}:{place}: "), str(refused.value)
    assert words in str(refused.value)


def test_playbook_name_must_be_the_files_name(tmp_path: Path) -> None:
    path = tmp_path / "one.yaml"
    path.write_text("name: two\ndescription: x\nsteps: []")
    with pytest.raises(PlaybookError, match=r"one.yaml:1:7: the name is 'two'"):
        load(path)


def test_circular_include_is_refused(write_playbook: Callable[..., Path]) -> None:
    write_playbook("steps:\n- include: second", "first")
    write_playbook("steps:\n- include: third", "second")
    write_playbook("steps:\n- include: first", "third")
    with pytest.raises(PlaybookError, match=r"third.yaml:4:12: includes itself: first → second → third → first"):
        load(write_playbook("steps:\n- include: second", "first"))


def test_include_refuses_unknown_variables(write_playbook: Callable[..., Path]) -> None:
    write_playbook(f"vars: {{port: 1}}\nsteps:\n- name: A\n  {FILE}", "inner")
    with pytest.raises(PlaybookError, match=r"outer.yaml:5:15: 'inner' has no variable 'prt'; did you mean 'port'"):
        load(write_playbook("steps:\n- include: inner\n  vars: {prt: 3}", "outer"))


def test_include_needs_variables_without_default(write_playbook: Callable[..., Path]) -> None:
    write_playbook(f"vars: {{port: {{type: integer}}}}\nsteps:\n- name: A\n  {FILE}", "inner")
    with pytest.raises(PlaybookError, match=r"outer.yaml:4:12: 'inner' needs the variable 'port'"):
        load(write_playbook("steps:\n- include: inner", "outer"))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is empty"),
        (b"name: \xff", "1:7: is not UTF-8 here"),
        (b"[" * 100_000, "more than 20 deep"),
        (b"#" * 300_000, "at most"),
    ],
)
def test_bytes_that_are_not_a_playbook_are_refused(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "book.yaml"
    path.write_bytes(data)
    with pytest.raises(PlaybookError) as refused:
        load(path)
    assert re.search(words, str(refused.value)), str(refused.value)


def test_unreadable_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PlaybookError, match="cannot be read: is a folder; expected a file"):
        load(tmp_path)


def test_yes_off_and_10_30_stay_text(load_playbook: Callable[..., Playbook]) -> None:
    playbook = load_playbook(
        "vars: {a: off, b: 10:30, c: 0644, d: yes}\nsteps:\n- name: A\n  on: laptop\n  file: {path: /a, content: on}"
    )
    assert [variable.default for variable in playbook.variables] == ["off", "10:30", 644, "yes"]
    assert playbook.steps[0].arguments["content"][0] == "on"


@given(st.text(max_size=200))
def test_any_text_is_parsed_or_refused(text: str) -> None:
    try:
        YamlSource("x.yaml", text)
    except PlaybookError as error:
        assert str(error).startswith("x.yaml")
