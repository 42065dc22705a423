"""Every command that Lupin tells an operator to type can be typed: `lupin` has it, with these options.

Two tests look at all of them: one reads the commands in the text of the sources, the other those that the gate completes.
"""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from lupin_cli.app import COMMANDS
from lupin_cli.playbook import find_playbook, list_shipped, load
from lupin_cli.printed_commands import complete, lupin, ssh
from tests.support.command_line import FIELD, mistake_in
from tests.support.paths import ROOT

SOURCES = sorted(path for name in ("lupin_cli", "lupin_runtime", "lupin_sim") for path in (ROOT / name).rglob("*.py"))
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "playbooks").glob("*.yaml")])
COMMAND = re.compile(r"(?<![\w/`.@-])lupin (?=-|[a-z])([^\n;,)`'\"|]*)")


def formatted(node: ast.JoinedStr, options: Mapping[str, str]) -> str:
    """Return an f-string's text: a field that holds options of a command becomes these, any other FIELD."""
    parts = []
    for part in node.values:
        value = part.value if isinstance(part, ast.FormattedValue) else None
        name = value.func if isinstance(value, ast.Call) else value
        parts.append(part.value if isinstance(part, ast.Constant) else options.get(getattr(name, "id", ""), FIELD))
    return "".join(map(str, parts))


def option_texts(tree: ast.AST) -> dict[str, str]:
    """Return the options that variables and functions of a module hold, such as ` --robot FIELD`, by their name."""
    found: dict[str, str] = {}
    for node in ast.walk(tree):
        names = [node.name] if isinstance(node, ast.FunctionDef) else []
        if isinstance(node, ast.Assign):
            names = [target.id for target in node.targets if isinstance(target, ast.Name)]
        for inner in ast.walk(node) if names else ():
            text = formatted(inner, {}) if isinstance(inner, ast.JoinedStr) else getattr(inner, "value", None)
            if isinstance(text, str) and re.match(" -{1,2}[a-z]", text):
                for name in names:
                    found.setdefault(name, text)  # the whole f-string is walked before its parts
    return found


FUNCTIONS = {  # of all modules: they are imported from one another
    name: text
    for path in SOURCES
    for name, text in option_texts(ast.parse(path.read_text(encoding="utf-8"))).items()
    if name.endswith("_option")
}


def texts(tree: ast.AST) -> Iterator[str]:
    """Yield the texts of a module that a person may read, but no docstring; a field of an f-string becomes FIELD."""
    options = {**FUNCTIONS, **option_texts(tree)}
    hidden = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            hidden.add(id(node.value))  # a docstring
        if isinstance(node, ast.JoinedStr):
            hidden.update(id(part) for part in ast.walk(node) if part is not node)
    for node in ast.walk(tree):
        if id(node) in hidden:
            continue
        if isinstance(node, ast.JoinedStr):
            yield formatted(node, options)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_in_messages_exist_with_their_options(path: Path) -> None:
    source = path.read_text(encoding="utf-8")
    if "lupin " not in source:
        return
    for text in texts(ast.parse(source)):
        assert not re.search(r"python3? -m lupin", text) or path.name in INTERNAL_PROGRAMS, (
            f"{text!r}: a path that no operator has"
        )
        for found in COMMAND.finditer(text):
            if re.match(r"[a-z- ]+:", found[1]):
                continue  # the name of the command that prints the message: `lupin play: ...`
            assert not mistake_in(found[1]), f"{found[0]!r}: {mistake_in(found[1])}"


def test_options_in_a_field_are_part_of_the_command() -> None:
    module = ast.parse(
        'named = f" --robot {name}" if name else ""\nprint(f"lupin transport{named}", f"lupin play {x}{robot_option(y)}")'
    )
    written = list(texts(module))
    assert written[-2:] == ["lupin transport --robot FIELD", "lupin play FIELD --robot FIELD"]
    assert mistake_in("transport --robot FIELD") and not mistake_in("play FIELD --robot FIELD")


INTERNAL_PROGRAMS = ("__main__.py", "daemon.py", "driver.py", "player.py")  # their own usage lines, for developers


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_commands_on_pages_exist_with_their_options(path: Path) -> None:
    text = re.sub(r"([\w-]+)(\\\|[\w-]+)+", r"\1", path.read_text(encoding="utf-8"))  # of alternatives, the first
    for line in text.splitlines():
        for found in re.finditer(r"(?:^|`|\$ |next: )lupin ([a-z][^`\n|#]*)", line):
            command = re.sub(r"\[[^\]]*\]|\{\{[^}]*\}\}|\\", " FIELD ", found[1]).split("  ")[0]
            first = command.split()[0]
            if first in COMMANDS:
                mistake = mistake_in(re.sub(r"\b[A-Z][A-Z_]+\b", "FIELD", command))
                assert not mistake, f"{found[0]!r}: {mistake}"


@pytest.mark.parametrize("path", list_shipped(), ids=lambda path: path.stem)
def test_playbook_that_a_command_names_is_shipped(path: Path) -> None:
    for name in re.findall(r"lupin play ([a-z-]+)", path.read_text()):
        assert load(find_playbook(name)).name == name


@pytest.mark.parametrize(
    ("command", "completed"),
    [
        ("", ""),
        ("lupin doctor", "lupin doctor --robot pot-1"),
        ("lupin deploy robot", "lupin deploy robot --robot pot-1"),
        ("lupin doctor --robot other", "lupin doctor --robot other"),
        ("lupin journal list", "lupin journal list"),
        ("lupin dds check", "lupin dds check"),
        ("lupin wait free && lupin play heal -v a=b", "lupin wait free --robot pot-1 && lupin play heal -v a=b --robot pot-1"),
        ("make setup", "make setup"),
        ("chmod 600 /home/ada/key", "chmod 600 /home/ada/key"),
        ("journalctl -u lupin-onboard -n 50", "ssh -p 2222 mirte@pot 'journalctl -u lupin-onboard -n 50'"),
        ("sudo systemctl restart mirte-ros", "ssh -t -p 2222 mirte@pot 'sudo systemctl restart mirte-ros'"),
        (
            "ssh -t pot 'sudo true && lupin play heal; x' && lupin play heal",
            "ssh -t pot 'sudo true && lupin play heal; x' && lupin play heal --robot pot-1",
        ),
        ("lupin dds setup 10.42.0.1 && source '/a && b'", "lupin dds setup 10.42.0.1 && source '/a && b'"),
        ("echo 'a b' | wc", "ssh -p 2222 mirte@pot 'echo '\"'\"'a b'\"'\"' | wc'"),
    ],
)
def test_command_is_completed_for_the_robot(command: str, completed: str) -> None:
    assert complete(command, robot="pot-1", login=ssh("mirte", "pot", 2222)) == completed
    assert complete(completed, robot="pot-1", login=ssh("mirte", "pot", 2222)) == completed, "twice is the same as once"


def test_command_of_this_machine_is_left_alone() -> None:
    assert complete("ss -lnu") == "ss -lnu"
    assert complete("lupin dds check") == "lupin dds check"


def test_built_command_is_split_as_it_was_given() -> None:
    words = ("play", "a file.yaml", "-v", "text=it's $HOME")
    assert shlex.split(lupin(*words, robot="pot 1")) == [
        "lupin",
        "play",
        "a file.yaml",
        "--robot",
        "pot 1",
        "-v",
        "text=it's $HOME",
    ]
