"""Conventions: names of tests are short, folders of tests mirror the packages, every help has an example, and so on."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.support.command_line import all_commands, mistake_in
from tests.support.paths import ROOT
from tests.support.waiting import WAIT_S

PACKAGES = ("lupin_cli", "lupin_runtime", "lupin_sim")
MAX_LENGTH = 60
CLOCKS = ("monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time")
DURATIONS = ("took_s", "elapsed_s", "waited_s")


def test_names_of_tests_are_at_most_60_characters() -> None:
    too_long = [
        f"{path.relative_to(ROOT)}::{node.name}"
        for path in (ROOT / "tests").rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and len(node.name) > MAX_LENGTH
        if node.name.startswith("test_")
    ]
    assert too_long == []


def test_every_package_has_a_folder_of_tests() -> None:
    folders = {path.parent.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("__init__.py")}
    assert {folder for folder in folders if not list((ROOT / "tests" / folder).glob("test_*.py"))} == set()


def test_every_folder_of_tests_mirrors_a_package() -> None:
    folders = {
        path.parent.relative_to(ROOT / "tests") for name in PACKAGES for path in (ROOT / "tests" / name).rglob("test_*.py")
    }
    assert {folder for folder in folders if not (ROOT / folder / "__init__.py").is_file()} == set()


def test_every_suppressed_lint_has_a_reason() -> None:
    folders = (*PACKAGES, "tests", "tools", "bench", "interfaces/rosidl_build")
    bare = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.search(r"# (ruff: )?noqa(: [A-Z0-9, ]+)?$", line)
    ]
    assert bare == []


def test_json_from_elsewhere_is_parsed_in_one_place() -> None:
    # json.loads raises RecursionError for deep nesting, which callers forget. Two programs run isolated, on their own inputs.
    exempt = {"lupin_runtime/json_text.py", "lupin_sim/host/link_emulator.py", "lupin_cli/link/path_agent.py"}
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    found = {str(path.relative_to(ROOT)) for path in paths if re.search(r"\bjson\.loads?\(", path.read_text(encoding="utf-8"))}
    assert found - exempt == set()


def test_command_line_prints_through_one_gate() -> None:
    # Text from elsewhere may hold sequences that a terminal obeys, and markup of rich's: `echo`, `confirm` and SafeConsole take
    # both away. JSON escapes control characters itself.
    gates = {"lupin_cli/terminal.py", "lupin_cli/safe_console.py", "lupin_cli/json_errors.py"}
    # They run on another machine, for a program that reads their output.
    sent = {"lupin_cli/facts/board_agent.py", "lupin_cli/link/path_agent.py", "lupin_cli/release/verify_release.py"}
    found = {
        f"{path.relative_to(ROOT)}: {ast.unparse(node)[:60]}"
        for path in (ROOT / "lupin_cli").rglob("*.py")
        if str(path.relative_to(ROOT)) not in gates | sent
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if _prints_raw(node)
    }
    assert found == set()


def _prints_raw(node: ast.AST) -> bool:
    """Return whether a node prints without the gate, or imports what does."""
    if isinstance(node, ast.ImportFrom):
        names = {alias.name for alias in node.names}
        return (bool(names & {"Console", "print", "print_json"}) and (node.module or "").split(".")[0] == "rich") or (
            bool(names & {"echo", "secho", "confirm", "prompt"}) and (node.module or "") in ("typer", "click")
        )
    if not isinstance(node, ast.Call):
        return False
    called = ast.unparse(node.func)
    if called == "print":
        first = node.args[0] if node.args else None
        return not (len(node.args) == 1 and isinstance(first, ast.Call) and ast.unparse(first.func) == "json.dumps")
    return called in {
        *(f"{module}.{name}" for module in ("typer", "click") for name in ("echo", "secho", "confirm", "prompt")),
        *(f"sys.{stream}.{name}" for stream in ("stdout", "stderr") for name in ("write", "writelines")),
        "rich.print", "rich.console.Console", "input",
    }  # fmt: skip


def test_help_of_every_command_has_an_example_that_can_be_typed() -> None:
    wrong = {}
    for words, command in all_commands():
        examples = re.findall(r"^Example: (.*)$", command.help or "", re.MULTILINE)
        typed = re.sub(r'^eval "\$\((.*)\)"$', r"\1", examples[0]) if len(examples) == 1 else ""
        mistake = mistake_in(typed.removeprefix("lupin")) if f"{typed} ".startswith(f"{words} ") else "not one example of it"
        if mistake:
            wrong[words] = (examples, mistake)
    assert wrong == {}


def elapsed_assertions(source: str) -> list[int]:
    """Return the lines of the assertions that a duration is short; `bench/` measures that instead."""
    return [
        compared.lineno
        for asserted in ast.walk(ast.parse(source))
        if isinstance(asserted, ast.Assert)
        for compared in ast.walk(asserted.test)
        if isinstance(compared, ast.Compare) and isinstance(compared.ops[0], (ast.Lt, ast.LtE)) and is_elapsed(compared.left)
    ]


def is_elapsed(node: ast.expr) -> bool:
    if isinstance(node, ast.Name):
        return node.id in DURATIONS
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub) and is_clock(node.left)


def is_clock(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CLOCKS


def test_no_test_asserts_how_long_something_took() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    found = [
        f"{path.relative_to(ROOT)}:{line}" for path in files for line in elapsed_assertions(path.read_text(encoding="utf-8"))
    ]
    assert found == [], "bench/ measures durations"


def page_durations(source: str) -> list[str]:
    """Return the page's assertions that a duration is short."""
    return re.findall(r"expect\((?:performance|Date)\.now\(\) *-.*", source)


def test_no_test_of_the_page_asserts_a_duration() -> None:
    files = [path for folder in ("src", "tests") for path in sorted((ROOT / "web" / folder).rglob("*.ts*"))]
    found = [f"{path.relative_to(ROOT)}: {line}" for path in files for line in page_durations(path.read_text("utf-8"))]
    assert found == [], "bench/ measures durations"


def short_limits(source: str) -> list[int]:
    """Return the lines of the limits of a wait, `timeout=SECONDS`, that assert that something is quick: 1 s to below WAIT_S."""
    return [
        keyword.value.lineno
        for call in ast.walk(ast.parse(source))
        if isinstance(call, ast.Call)
        for keyword in call.keywords
        if keyword.arg == "timeout" and isinstance(keyword.value, ast.Constant)
        if isinstance(keyword.value.value, int | float) and 1 <= keyword.value.value < WAIT_S
    ]


def test_no_limit_of_a_wait_asserts_how_long_it_takes() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    found = [f"{path.relative_to(ROOT)}:{line}" for path in files for line in short_limits(path.read_text(encoding="utf-8"))]
    assert found == [], "a limit that is only there to end a failed test is 60 s or longer"


def bare_sleeps(node: ast.AST, *, in_test: bool = False) -> Iterator[int]:
    """Yield the lines of the sleeps of tests themselves, outside loops: `wait_until` or `wait_for_nothing` says what for."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from bare_sleeps(child, in_test=getattr(child, "name", "").startswith("test_"))
        elif not isinstance(child, ast.For | ast.While):
            if in_test and isinstance(child, ast.Call) and ast.unparse(child.func) == "time.sleep":
                yield child.lineno
            yield from bare_sleeps(child, in_test=in_test)


def test_no_test_sleeps_and_hopes() -> None:
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    found = [f"{path.relative_to(ROOT)}:{line}" for path in files for line in bare_sleeps(ast.parse(path.read_text("utf-8")))]
    assert found == [], "tests.support.waiting has wait_until and wait_for_nothing"


def own_loops(source: str) -> list[int]:
    """Return the lines of the loops that wait until a deadline of their own."""
    return [
        loop.lineno
        for loop in ast.walk(ast.parse(source))
        if isinstance(loop, ast.While)
        for compared in ast.walk(loop)
        if isinstance(compared, ast.Compare) and any(is_clock(side) for side in (compared.left, *compared.comparators))
    ]


def test_tests_wait_by_one_loop() -> None:
    files = sorted({*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "tests").rglob("conftest.py")})
    found = [f"{path.relative_to(ROOT)}:{line}" for path in files for line in own_loops(path.read_text(encoding="utf-8"))]
    assert found == [], "tests.support.waiting has wait_until"


def test_rule_finds_what_it_forbids() -> None:
    assert own_loops("end = 5\nwhile not done:\n    assert time.monotonic() < end\n") == [2]
    assert own_loops("while not over.wait(0.1):\n    send(time.monotonic())\n") == []
    assert list(bare_sleeps(ast.parse("def test_it():\n    start()\n    time.sleep(0.2)\n    assert done\n"))) == [3]
    assert not list(bare_sleeps(ast.parse("def test_it():\n    def slow():\n        time.sleep(0.2)\n    run(slow)\n")))
    forbidden = "def test():\n    began = time.monotonic()\n    assert done and time.monotonic() - began < 2.0\n"
    assert elapsed_assertions(forbidden) == [3]
    assert short_limits("run(timeout=60)\nrun(timeout=0.1)\nrun(timeout=None)\nrun(\n    timeout=20.0)\n") == [5]
    assert elapsed_assertions("assert took_s < 2.0\n") == [1]
    assert page_durations("  expect(performance.now() - startMs).toBeLessThan(500);\n") != []
    assert page_durations("  expect(performance.now()).toBeGreaterThan(0);\n") == []
    assert elapsed_assertions("assert time.monotonic() < deadline\nassert 0 < rate_hz < 3\n") == []
